// Several dependent loops in one parallel_for: one wake-up of the team instead of
// one per loop.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <thread>
#include <vector>

#include "common/parallel.hpp"

namespace sono {

/// Calls body(phase, block) for every block of every phase; a phase starts once the one
/// before is done. No deadlock: blocks are claimed in ascending order, so whoever waits
/// waits for blocks that some running thread has claimed already; where one has failed, nobody waits.
template <class Body> void parallel_phases(const std::vector<std::size_t> &blocks, const Body &body) {
    std::size_t total = 0;
    for (std::size_t count : blocks) total += count;
    const auto left = std::make_unique<std::atomic<std::size_t>[]>(blocks.size());
    for (std::size_t phase = 0; phase < blocks.size(); ++phase) left[phase].store(blocks[phase]);
    std::atomic<bool> failed{false};
    parallel_for(total, [&](std::size_t block) {
        std::size_t phase = 0;
        while (block >= blocks[phase]) block -= blocks[phase++];
        if (phase)
            wait_for([&] { return left[phase - 1].load(std::memory_order_acquire) == 0 || failed.load(); });
        if (failed.load(std::memory_order_relaxed)) return;
        try {
            body(phase, block);
        } catch (...) {
            failed.store(true);
            throw;
        }
        left[phase].fetch_sub(1, std::memory_order_acq_rel);
    });
}

}  // namespace sono

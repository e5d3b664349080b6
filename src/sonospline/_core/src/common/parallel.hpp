// A small persistent thread team: blocks are claimed one by one from a shared
// counter, so a core that is busy elsewhere delays the sum by one block at most.
// Waiting is passive (condition variables); nothing spins.
#pragma once

#include <cstddef>
#include <chrono>
#include <functional>
#include <thread>

namespace sono {

/// Threads used by parallel_for: the calling one included, at least 1 and at most 1024.
int thread_count();
void set_thread_count(int count);

/// Calls body(block) once for each block in [0, blocks), in no fixed order.
/// Runs in the calling thread alone where there is one block or one thread, or the system grants no more.
/// Where a block throws, those not yet begun are left out, and the first exception reaches the caller.
void parallel_for(std::size_t blocks, const std::function<void(std::size_t)> &body);

/// Ends the team's threads, and keeps others from making a new one until release_team: around a fork.
void hold_team();
void release_team();

/// Waits for other threads of the team: soon, by yielding; then by sleeping, since the
/// thread waited for may be queued on this very core, where yielding need not let it run.
template <class Condition> void wait_for(const Condition &met) {
    for (int tries = 0; !met(); ++tries) {
        if (tries < 200)
            std::this_thread::yield();
        else
            std::this_thread::sleep_for(std::chrono::microseconds(20));
    }
}

}  // namespace sono

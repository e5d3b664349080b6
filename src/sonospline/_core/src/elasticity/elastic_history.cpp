#include "elasticity/elastic_history.hpp"

#include <algorithm>
#include <cmath>

#include "common/parallel.hpp"

namespace sono {
namespace {

constexpr std::size_t kBlock = 1 << 15, kAlone = 1 << 19;  // floats of a block, and those that one thread does at once

}  // namespace

void follow(const Following &f, float nil, float *out) {
    const std::size_t blocks = (f.size + kBlock - 1) / kBlock;
    // Block by block of all the fields: start and change stay in the cache.
    const auto body = [&](std::size_t block) {
        const std::size_t first = block * kBlock, last = std::min(f.size, first + kBlock);
        for (std::size_t field = 0; field < f.fields; ++field) {
            const float forgotten = static_cast<float>(f.forgotten[field]), taken_up = static_cast<float>(f.taken_up[field]);
            const float *const values = f.values + field * f.size;
            float *const to = out + field * f.size;
            for (std::size_t i = first; i < last; ++i) {
                const float next = values[i] + forgotten * (f.start[i] - values[i]) + taken_up * f.change[i];
                to[i] = std::fabs(next) < nil ? 0.f : next;
            }
        }
    };
    if (f.fields * f.size > kAlone)
        parallel_for(blocks, body);
    else
        for (std::size_t block = 0; block < blocks; ++block) body(block);
}

}  // namespace sono

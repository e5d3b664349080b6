#include "common/buffers.hpp"

#include <array>
#include <cstdint>
#include <cstdlib>
#include <mutex>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace sono {
namespace {

constexpr std::size_t kHugePage = std::size_t(2) << 20, kCacheLine = 64;
// Small results come fast from malloc; very large ones are not worth holding on to.
constexpr std::size_t kSmallestKept = std::size_t(64) << 10, kLargestKept = std::size_t(16) << 20;

struct Kept {
    void *memory = nullptr;
    std::size_t bytes = 0;
};

std::mutex mutex;
std::array<Kept, 4> kept;

bool keeps(std::size_t bytes) { return bytes >= kSmallestKept && bytes <= kLargestKept; }

void *allocate(std::size_t bytes) {
    const std::size_t alignment = bytes < 2 * kHugePage ? kCacheLine : kHugePage;
    if (bytes > SIZE_MAX - alignment) throw std::bad_array_new_length();
    const std::size_t rounded = (bytes + alignment - 1) / alignment * alignment;
    void *memory = std::aligned_alloc(alignment, rounded ? rounded : alignment);
    if (!memory) throw std::bad_alloc();
#if defined(__linux__)
    if (alignment == kHugePage) madvise(memory, rounded, MADV_HUGEPAGE);
#endif
    return memory;
}

}  // namespace

void *take_buffer(std::size_t bytes) {
    if (keeps(bytes)) {
        std::lock_guard<std::mutex> lock(mutex);
        for (Kept &slot : kept)
            if (slot.memory && slot.bytes == bytes) {
                void *const memory = slot.memory;
                slot.memory = nullptr;
                return memory;
            }
    }
    return allocate(bytes);
}

void return_buffer(void *memory, std::size_t bytes) noexcept {
    if (keeps(bytes)) {
        std::lock_guard<std::mutex> lock(mutex);
        for (Kept &slot : kept)
            if (!slot.memory) {
                slot = {memory, bytes};
                return;
            }
        std::swap(memory, kept[0].memory);  // the oldest makes room
        kept[0].bytes = bytes;
    }
    std::free(memory);
}

void hold_buffers() { mutex.lock(); }

void release_buffers() { mutex.unlock(); }

}  // namespace sono

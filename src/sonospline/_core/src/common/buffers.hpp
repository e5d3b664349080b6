// Memory of results. A freed result is kept for the next one of its size: the first touch
// of fresh pages costs as much as a whole fast sum.
#pragma once

#include <array>
#include <cstddef>
#include <new>
#include <utility>

namespace sono {

/// At least `bytes`, on huge pages where that is large; throws std::bad_alloc.
void *take_buffer(std::size_t bytes);
/// Gives back what take_buffer(bytes) returned.
void return_buffer(void *memory, std::size_t bytes) noexcept;

/// Bytes of so many items in all; throws std::bad_array_new_length where no number holds them.
template <class Sizes> std::size_t bytes_of(std::size_t item, const Sizes &sizes) {
    std::size_t bytes = item;
    for (const std::size_t size : sizes)
        if (__builtin_mul_overflow(bytes, size, &bytes)) throw std::bad_array_new_length();
    return bytes;
}

/// Keeps others from taking and returning memory until release_buffers: around a fork.
void hold_buffers();
void release_buffers();

/// An array in such memory.
template <class T> class Buffer {
  public:
    Buffer() = default;
    explicit Buffer(std::size_t size)
        : data_(static_cast<T *>(take_buffer(bytes_of(sizeof(T), std::array{size})))), size_(size) {}
    Buffer(Buffer &&other) noexcept { swap(other); }
    Buffer &operator=(Buffer &&other) noexcept {
        swap(other);
        return *this;
    }
    Buffer(const Buffer &) = delete;
    Buffer &operator=(const Buffer &) = delete;
    ~Buffer() {
        if (data_) return_buffer(data_, size_ * sizeof(T));
    }
    T *data() { return data_; }
    const T *data() const { return data_; }

  private:
    void swap(Buffer &other) noexcept {
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
    }
    T *data_ = nullptr;
    std::size_t size_ = 0;
};

}  // namespace sono

// Memory of results. A freed result is kept for the next one of its size: the first touch
// of fresh pages costs as much as a whole fast sum.
#pragma once

#include <cstddef>
#include <utility>

namespace sono {

/// At least `bytes`, on huge pages where that is large; throws std::bad_alloc.
void *take_buffer(std::size_t bytes);
/// Gives back what take_buffer(bytes) returned.
void return_buffer(void *memory, std::size_t bytes) noexcept;

/// An array in such memory.
template <class T> class Buffer {
  public:
    Buffer() = default;
    explicit Buffer(std::size_t size) : data_(static_cast<T *>(take_buffer(size * sizeof(T)))), size_(size) {}
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

#include "models/cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/cholesky_kernels.hpp"
#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "common/require.hpp"

namespace sono {
namespace {

// Multiplications below which a second thread costs more than it saves.
constexpr std::size_t kWorkWorthAThread = 1'000'000;
// Rows of a block: enough for the panel it reads, few enough for the second cache.
constexpr std::size_t kFewestRows = 4, kMostRows = 48;

template <class Body> void over_row_blocks(std::size_t begin, std::size_t end, std::size_t work, const Body &body) {
    const std::size_t rows = end - begin;
    if (!rows) return;
    const std::size_t share = work < kWorkWorthAThread ? rows : (rows + thread_count() - 1) / thread_count();
    const std::size_t per_block = std::clamp(share, kFewestRows, kMostRows);
    const std::size_t blocks = (rows + per_block - 1) / per_block;
    parallel_for(blocks, [&](std::size_t block) {
        body(begin + rows * block / blocks, begin + rows * (block + 1) / blocks);
    });
}

}  // namespace

void CholeskyFactor::reserve(std::size_t rows) {
    const std::lock_guard<std::mutex> lock(in_use_);
    grow(rows);
}

void CholeskyFactor::grow(std::size_t rows) {
    if (rows <= stride_) return;
    if (rows > kMostNodes) throw std::bad_array_new_length();
    const std::size_t stride = (rows + 15) / 16 * 16 + 8;  // no power of two: cache sets
    Buffer<double> data(stride * stride);
    for (std::size_t i = 0; i < size_; ++i) std::copy_n(row(i), i + 1, data.data() + i * stride);
    data_ = std::move(data);
    stride_ = stride;
}

bool CholeskyFactor::append(const double *rows, std::size_t m, std::size_t columns, double smallest_pivot) {
    const std::lock_guard<std::mutex> lock(in_use_);
    const std::size_t begin = size_, end = begin + m;
    require(columns == end, "rows is not (m, size + m)");
    if (end > stride_) grow(std::max(end, stride_ + stride_ / 2));
    for (std::size_t i = begin; i < end; ++i) std::copy_n(rows + (i - begin) * end, i + 1, row(i));
    // Against the old rows the new ones are independent of one another ...
    over_row_blocks(begin, end, m * begin * begin / 2, [&](std::size_t first, std::size_t last) {
        for (std::size_t from = 0; from < begin; from += kPanel)
            eliminate(first, last, from, std::min(kPanel, begin - from));
    });
    // ... and among themselves they go panel by panel.
    for (std::size_t from = begin; from < end; from += kPanel) {
        const std::size_t width = std::min(kPanel, end - from), below = from + width;
        if (!factor_corner(from, width, smallest_pivot)) return false;
        over_row_blocks(below, end, (end - below) * width * from,
                        [&](std::size_t first, std::size_t last) { eliminate(first, last, from, width); });
    }
    size_ = end;
    return true;
}

void CholeskyFactor::eliminate(std::size_t first, std::size_t last, std::size_t from, std::size_t columns) {
    const CholeskyKernels &inner = *kernels().cholesky;
    inner.update(row(first), row(from), row(first) + from, last - first, columns, from, stride_);
    inner.eliminate(row(from) + from, row(first) + from, last - first, columns, stride_);
}

bool CholeskyFactor::factor_corner(std::size_t from, std::size_t columns, double smallest_pivot) {
    kernels().cholesky->update(row(from), row(from), row(from) + from, columns, columns, from, stride_);
    for (std::size_t j = from; j < from + columns; ++j) {
        double *const l = row(j);
        for (std::size_t k = from; k < j; ++k) {
            double sum = l[k];
            for (std::size_t t = from; t < k; ++t) sum -= l[t] * row(k)[t];
            l[k] = sum / row(k)[k];
        }
        double pivot = l[j];
        for (std::size_t t = from; t < j; ++t) pivot -= l[t] * l[t];
        if (!(pivot > smallest_pivot)) return false;
        l[j] = std::sqrt(pivot);
    }
    return true;
}

void CholeskyFactor::truncate(std::size_t size) {
    const std::lock_guard<std::mutex> lock(in_use_);
    size_ = std::min(size, size_.load());
    known_ = std::min(known_, size_.load());
}

// Rows from the start on, whole groups of them, where b is what it was.
std::size_t CholeskyFactor::unchanged(const double *b, std::size_t n, std::size_t first) const {
    std::size_t same = std::min(known_, n);
    if (first != first_ || same <= first) return first;
    for (std::size_t a = 0; a < 3; ++a) {
        const double *const old = right_[a].data(), *const now = b + a * n;
        same = static_cast<std::size_t>(std::mismatch(old + first, old + same, now + first).first - old);
    }
    return first + (same - first) / kForwardRows * kForwardRows;
}

void CholeskyFactor::solve(double *x, std::size_t n, std::size_t first) {
    const std::lock_guard<std::mutex> lock(in_use_);
    require(n <= size_, "x is not (3, size) or shorter");
    require(first <= n, "first is beyond the rows of x");
    const CholeskyKernels &inner = *kernels().cholesky;
    const std::size_t begin = unchanged(x, n, first);
    known_ = 0;  // until all of what follows is done
    for (std::size_t a = 0; a < 3; ++a) {
        right_[a].assign(x + a * n, x + (a + 1) * n);
        half_[a].resize(n);
        std::copy(half_[a].begin() + static_cast<std::ptrdiff_t>(first),
                  half_[a].begin() + static_cast<std::ptrdiff_t>(begin), x + a * n + first);
    }
    inner.forward(data_.data(), x, first, begin, n, stride_);
    for (std::size_t a = 0; a < 3; ++a)
        std::copy(x + a * n + begin, x + (a + 1) * n, half_[a].begin() + static_cast<std::ptrdiff_t>(begin));
    known_ = n, first_ = first;
    inner.backward(data_.data(), x, n, stride_);
}

}  // namespace sono

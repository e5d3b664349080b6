#include "cholesky.hpp"

#include <algorithm>
#include <cmath>

#include "cholesky_kernels.hpp"
#include "kernels.hpp"
#include "parallel.hpp"

namespace sono {
namespace {

// Multiplications below which a second thread costs more than it saves.
constexpr std::size_t kWorkWorthAThread = 300'000;
constexpr std::size_t kRowsPerBlock = 32;

}  // namespace

void CholeskyFactor::reserve(std::size_t rows) {
    if (rows <= stride_) return;
    const std::size_t stride = (std::max(rows, stride_ + stride_ / 2) + 15) / 16 * 16 + 8;  // no power of two: cache sets
    std::vector<double> data(stride * stride);
    for (std::size_t i = 0; i < size_; ++i) std::copy_n(row(i), i + 1, data.data() + i * stride);
    data_.swap(data);
    stride_ = stride;
}

bool CholeskyFactor::append(const double *rows, std::size_t m, double smallest_pivot) {
    const std::size_t begin = size_, end = size_ + m;
    reserve(end);
    for (std::size_t i = begin; i < end; ++i) std::copy_n(rows + (i - begin) * end, i + 1, row(i));
    // Left-looking, a panel of columns at a time; no panel straddles old and new rows.
    for (std::size_t from = 0; from < end;) {
        const std::size_t limit = from < begin ? begin : end;
        const std::size_t columns = std::min(kPanel, limit - from);
        if (!factor_panel(begin, end, from, columns, smallest_pivot)) return false;
        from += columns;
    }
    size_ = end;
    return true;
}

bool CholeskyFactor::factor_panel(std::size_t begin, std::size_t end, std::size_t from, std::size_t columns,
                                  double smallest_pivot) {
    const CholeskyKernels &inner = *kernels().cholesky;
    std::size_t below = begin;
    if (from >= begin) {  // the panel's own rows are new: factor its corner first
        inner.update(row(from), row(from), row(from) + from, columns, columns, from, stride_);
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
        below = from + columns;
    }
    const std::size_t rows = end - below;
    const std::size_t blocks =
        rows * columns * from < kWorkWorthAThread ? 1 : (rows + kRowsPerBlock - 1) / kRowsPerBlock;
    parallel_for(rows ? blocks : 0, [&](std::size_t block) {
        const std::size_t first = below + rows * block / blocks, last = below + rows * (block + 1) / blocks;
        inner.update(row(first), row(from), row(first) + from, last - first, columns, from, stride_);
        inner.eliminate(row(from) + from, row(first) + from, last - first, columns, stride_);
    });
    return true;
}

void CholeskyFactor::truncate(std::size_t size) { size_ = std::min(size, size_); }

void CholeskyFactor::solve(double *x, std::size_t n, std::size_t first) const {
    const CholeskyKernels &inner = *kernels().cholesky;
    inner.forward(data_.data(), x, first, n, stride_);
    inner.backward(data_.data(), x, n, stride_);
}

}  // namespace sono

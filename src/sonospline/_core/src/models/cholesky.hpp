// A Cholesky factor that grows row by row and can be cut back: landmarks are
// appended as the needle advances, and dropped as it is pulled back.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <mutex>
#include <vector>

#include "common/buffers.hpp"

namespace sono {

/// Threads may share one: each call has it alone. What a thread does not know, another may have changed between two
/// calls.
class CholeskyFactor {
  public:
    std::size_t size() const { return size_.load(); }

    /// Appends m rows of a positive definite matrix, given as (m, columns), with as many columns as
    /// rows there will be; only the part up to the diagonal is read. Returns false, and leaves the
    /// factor as it was, where a pivot is at or below `smallest_pivot`.
    bool append(const double *rows, std::size_t m, std::size_t columns, double smallest_pivot);

    /// Drops all rows from `size` on.
    void truncate(std::size_t size);

    /// Solves A x = b in place for the first n rows, three right-hand sides (3, n), zero before `first`. As far as b
    /// is that of the last solve, so is the forward half of this one: a step of a needle changes few targets.
    void solve(double *x, std::size_t n, std::size_t first);

    /// Makes room for so many rows at once: growing later copies everything.
    void reserve(std::size_t rows);

  private:
    void grow(std::size_t rows);
    void eliminate(std::size_t first, std::size_t last, std::size_t from, std::size_t columns);
    bool factor_corner(std::size_t from, std::size_t columns, double smallest_pivot);
    std::size_t unchanged(const double *b, std::size_t n, std::size_t first) const;
    double *row(std::size_t i) { return data_.data() + i * stride_; }

    Buffer<double> data_;
    std::size_t stride_ = 0;
    std::atomic<std::size_t> size_{0};

    std::mutex in_use_;
    std::array<std::vector<double>, 3> right_, half_;  // b and L^-1 b of the last solve
    std::size_t known_ = 0, first_ = 0;                // rows of them that still hold, and where b begins
};

}  // namespace sono

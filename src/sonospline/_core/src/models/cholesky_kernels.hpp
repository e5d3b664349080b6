// The inner loops of the growing Cholesky factor, once per instruction set.
// Matrices are row-major; `stride` is the distance between rows.
#pragma once

#include <cstddef>

namespace sono {

constexpr std::size_t kPanel = 16;       // columns eliminated together
constexpr std::size_t kForwardRows = 4;  // rows of a forward substitution, taken together

struct CholeskyKernels {
    /// target (m x kPanel or less) -= rows (m x depth) * panel (columns x depth)^T
    void (*update)(const double *rows, const double *panel, double *target, std::size_t m, std::size_t columns,
                   std::size_t depth, std::size_t stride);
    /// target (m x columns) <- target * inverse(lower triangle of `corner`)^T
    void (*eliminate)(const double *corner, double *target, std::size_t m, std::size_t columns, std::size_t stride);
    /// Solves L x = b for rows [begin, n) of three right-hand sides, n values apart; b is 0 before `first`. Rows before
    /// `begin`, which is a multiple of kForwardRows after `first`, are solved: the result is the same to the last bit.
    void (*forward)(const double *factor, double *x, std::size_t first, std::size_t begin, std::size_t n,
                    std::size_t stride);
    /// Solves L^T x = b likewise, all rows.
    void (*backward)(const double *factor, double *x, std::size_t n, std::size_t stride);
};

}  // namespace sono

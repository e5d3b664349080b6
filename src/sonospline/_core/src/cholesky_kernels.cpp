// Compiled once per instruction set (SONO_ISA names it).
#include "cholesky_kernels.hpp"

#include <algorithm>

#include "vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr std::size_t kLanes = lanes<double>;

inline double total(VecD v) {
    double sum = 0;
    for (std::size_t i = 0; i < kLanes; ++i) sum += v[i];
    return sum;
}

// A block of R x C dot products over `depth`, all accumulators in registers.
template <int R, int C>
void dots(const double *rows, const double *panel, double *target, std::size_t depth, std::size_t stride) {
    VecD sum[R][C] = {};
    std::size_t k = 0;
    for (; k + kLanes <= depth; k += kLanes) {
        VecD b[C];
        for (int c = 0; c < C; ++c) b[c] = load(panel + c * stride + k);
        for (int r = 0; r < R; ++r) {
            const VecD a = load(rows + r * stride + k);
            for (int c = 0; c < C; ++c) sum[r][c] += a * b[c];
        }
    }
    for (int r = 0; r < R; ++r)
        for (int c = 0; c < C; ++c) {
            double rest = total(sum[r][c]);
            for (std::size_t t = k; t < depth; ++t) rest += rows[r * stride + t] * panel[c * stride + t];
            target[r * stride + c] -= rest;
        }
}

template <int R>
void update_rows(const double *rows, const double *panel, double *target, std::size_t columns, std::size_t depth,
                 std::size_t stride) {
    constexpr int C = kUnroll;
    std::size_t c = 0;
    for (; c + C <= columns; c += C) dots<R, C>(rows, panel + c * stride, target + c, depth, stride);
    for (; c < columns; ++c) dots<R, 1>(rows, panel + c * stride, target + c, depth, stride);
}

void update(const double *rows, const double *panel, double *target, std::size_t m, std::size_t columns,
            std::size_t depth, std::size_t stride) {
    std::size_t r = 0;
    for (; r + 4 <= m; r += 4) update_rows<4>(rows + r * stride, panel, target + r * stride, columns, depth, stride);
    // The last rows together too: each pass reads the whole panel from memory.
    rows += r * stride, target += r * stride;
    switch (m - r) {
        case 3: return update_rows<3>(rows, panel, target, columns, depth, stride);
        case 2: return update_rows<2>(rows, panel, target, columns, depth, stride);
        case 1: return update_rows<1>(rows, panel, target, columns, depth, stride);
    }
}

// Eight rows at a time, transposed so that the recurrence runs across vector lanes.
void eliminate(const double *corner, double *target, std::size_t m, std::size_t columns, std::size_t stride) {
    constexpr std::size_t kRows = 8;
    for (std::size_t r = 0; r < m; r += kRows) {
        const std::size_t used = std::min(kRows, m - r);
        double x[kPanel][kRows] = {};
        for (std::size_t i = 0; i < used; ++i)
            for (std::size_t j = 0; j < columns; ++j) x[j][i] = target[(r + i) * stride + j];
        for (std::size_t j = 0; j < columns; ++j) {
            for (std::size_t k = 0; k < j; ++k) {
                const double factor = corner[j * stride + k];
                for (std::size_t i = 0; i < kRows; ++i) x[j][i] -= factor * x[k][i];
            }
            const double inverse = 1.0 / corner[j * stride + j];
            for (std::size_t i = 0; i < kRows; ++i) x[j][i] *= inverse;
        }
        for (std::size_t i = 0; i < used; ++i)
            for (std::size_t j = 0; j < columns; ++j) target[(r + i) * stride + j] = x[j][i];
    }
}

void forward(const double *factor, double *x, std::size_t first, std::size_t n, std::size_t stride) {
    for (std::size_t i = first; i < n; ++i) {
        const double *row = factor + i * stride;
        VecD sum[3] = {};
        std::size_t k = first;
        for (; k + kLanes <= i; k += kLanes) {
            const VecD l = load(row + k);
            for (int a = 0; a < 3; ++a) sum[a] += l * load(x + a * n + k);
        }
        for (int a = 0; a < 3; ++a) {
            double dot = total(sum[a]);
            for (std::size_t t = k; t < i; ++t) dot += row[t] * x[a * n + t];
            x[a * n + i] = (x[a * n + i] - dot) / row[i];
        }
    }
}

void backward(const double *factor, double *x, std::size_t n, std::size_t stride) {
    for (std::size_t i = n; i-- > 0;) {
        const double *row = factor + i * stride;
        double solved[3];
        for (int a = 0; a < 3; ++a) solved[a] = x[a * n + i] /= row[i];
        std::size_t k = 0;
        for (; k + kLanes <= i; k += kLanes) {
            const VecD l = load(row + k);
            for (int a = 0; a < 3; ++a) store(x + a * n + k, load(x + a * n + k) - solved[a] * l);
        }
        for (; k < i; ++k)
            for (int a = 0; a < 3; ++a) x[a * n + k] -= solved[a] * row[k];
    }
}

}  // namespace

extern const CholeskyKernels cholesky_kernels;
const CholeskyKernels cholesky_kernels = {update, eliminate, forward, backward};

}  // namespace SONO_ISA
}  // namespace sono

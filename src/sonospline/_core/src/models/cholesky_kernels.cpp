// Compiled once per instruction set (SONO_ISA names it).
#include "models/cholesky_kernels.hpp"

#include <algorithm>

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr std::size_t kLanes = lanes<double>;
constexpr std::size_t kDepth = 512;   // of a dot product at a time: its panel columns stay in the first cache
constexpr std::size_t kRowGroup = 6;  // with kUnroll columns it fills the registers
constexpr std::size_t kRowsTogether = 8;  // streams from memory at once, in a back-substitution

inline double total(VecD v) {
#if defined(__AVX512F__)
    return _mm512_reduce_add_pd((__m512d)v);
#else
    double sum = 0;
    for (std::size_t i = 0; i < kLanes; ++i) sum += v[i];
    return sum;
#endif
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

// C columns of the panel against all rows: what they take of the cache is read once and stays there.
template <int C>
void update_columns(const double *rows, const double *panel, double *target, std::size_t m, std::size_t depth,
                    std::size_t stride) {
    std::size_t r = 0;
    for (; r + kRowGroup <= m; r += kRowGroup)
        dots<kRowGroup, C>(rows + r * stride, panel, target + r * stride, depth, stride);
    rows += r * stride, target += r * stride;
    switch (m - r) {
        case 5: return dots<5, C>(rows, panel, target, depth, stride);
        case 4: return dots<4, C>(rows, panel, target, depth, stride);
        case 3: return dots<3, C>(rows, panel, target, depth, stride);
        case 2: return dots<2, C>(rows, panel, target, depth, stride);
        case 1: return dots<1, C>(rows, panel, target, depth, stride);
    }
}

void update(const double *rows, const double *panel, double *target, std::size_t m, std::size_t columns,
            std::size_t depth, std::size_t stride) {
    constexpr int C = kUnroll;
    for (std::size_t k = 0; k < depth; k += kDepth) {
        const std::size_t part = depth - k < kDepth ? depth - k : kDepth;
        std::size_t c = 0;
        for (; c + C <= columns; c += C)
            update_columns<C>(rows + k, panel + c * stride + k, target + c, m, part, stride);
        for (; c < columns; ++c) update_columns<1>(rows + k, panel + c * stride + k, target + c, m, part, stride);
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

// x[a][k] -= sum over R rows of solved[r][a] * row[k], for k < end: x is read and written once for R rows.
template <int R>
void subtract_rows(const double *rows, const double (*solved)[3], double *x, std::size_t end, std::size_t n,
                   std::size_t stride) {
    std::size_t k = 0;
    for (; k + kLanes <= end; k += kLanes) {
        VecD l[R];
        for (int r = 0; r < R; ++r) l[r] = load(rows + r * stride + k);
        for (int a = 0; a < 3; ++a) {
            VecD sum = load(x + a * n + k);
            for (int r = 0; r < R; ++r) sum -= solved[r][a] * l[r];
            store(x + a * n + k, sum);
        }
    }
    for (; k < end; ++k)
        for (int r = 0; r < R; ++r)
            for (int a = 0; a < 3; ++a) x[a * n + k] -= solved[r][a] * rows[r * stride + k];
}

// Rows [end - R, end) of L^T x = b, and what they leave to the rows before.
template <int R> void backward_rows(const double *factor, double *x, std::size_t end, std::size_t n, std::size_t stride) {
    const std::size_t begin = end - R;
    double solved[R][3];
    for (int r = R; r-- > 0;) {
        const double *const row = factor + (begin + r) * stride + begin;
        for (int a = 0; a < 3; ++a) {
            double *const b = x + a * n + begin;
            solved[r][a] = b[r] /= row[r];
            for (int t = 0; t < r; ++t) b[t] -= solved[r][a] * row[t];
        }
    }
    subtract_rows<R>(factor + begin * stride, solved, x, begin, n, stride);
}

void backward(const double *factor, double *x, std::size_t n, std::size_t stride) {
    std::size_t end = n;
    for (; end >= kRowsTogether; end -= kRowsTogether) backward_rows<kRowsTogether>(factor, x, end, n, stride);
    for (; end > 0; --end) backward_rows<1>(factor, x, end, n, stride);
}

// Rows [i, i + R) of L x = b, given the solution from `first` up to i.
template <int R>
void forward_rows(const double *factor, double *x, std::size_t first, std::size_t i, std::size_t n, std::size_t stride) {
    const double *const rows = factor + i * stride;
    VecD sum[R][3] = {};
    std::size_t k = first;
    for (; k + kLanes <= i; k += kLanes) {
        VecD v[3];
        for (int a = 0; a < 3; ++a) v[a] = load(x + a * n + k);
        for (int r = 0; r < R; ++r) {
            const VecD l = load(rows + r * stride + k);
            for (int a = 0; a < 3; ++a) sum[r][a] += l * v[a];
        }
    }
    for (int r = 0; r < R; ++r)
        for (int a = 0; a < 3; ++a) {
            double dot = total(sum[r][a]);
            for (std::size_t t = k; t < i + r; ++t) dot += rows[r * stride + t] * x[a * n + t];
            x[a * n + i + r] = (x[a * n + i + r] - dot) / rows[r * stride + i + r];
        }
}

void forward(const double *factor, double *x, std::size_t first, std::size_t begin, std::size_t n,
             std::size_t stride) {
    std::size_t i = begin;
    for (; i + kForwardRows <= n; i += kForwardRows) forward_rows<kForwardRows>(factor, x, first, i, n, stride);
    switch (n - i) {
        case 3: return forward_rows<3>(factor, x, first, i, n, stride);
        case 2: return forward_rows<2>(factor, x, first, i, n, stride);
        case 1: return forward_rows<1>(factor, x, first, i, n, stride);
    }
}

}  // namespace

extern const CholeskyKernels cholesky_kernels;
const CholeskyKernels cholesky_kernels = {update, eliminate, forward, backward};

}  // namespace SONO_ISA
}  // namespace sono

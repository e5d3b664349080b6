// Compiled once per instruction set (SONO_ISA names it), like kernels.cpp.
#include "common/row_kernels.hpp"

#include <cstdint>

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr int kWidth = lanes<float>;
constexpr std::size_t kFlush = 32 * kWidth;  // terms summed in float before they join a double

void add(float factor, const float *y, float *x, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) x[i] += factor * y[i];
}

void extend(float factor, const float *y, float *x, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) x[i] = y[i] + factor * x[i];
}

void add_masked(float factor, const float *y, const float *mask, float *x, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) x[i] = mask[i] > 0 ? x[i] + factor * y[i] : 0;
}

double lengths(const float *x, const float *y, const float *z, std::size_t n) {
    double total = 0;
    for (std::size_t chunk = 0; chunk < n; chunk += kFlush) {  // n is a multiple of every vector's width
        const std::size_t end = chunk + kFlush < n ? chunk + kFlush : n;
        VecF sum{};
        for (std::size_t i = chunk; i < end; i += kWidth) {
            const VecF a = load(x + i), b = load(y + i), c = load(z + i);
            sum += root<float>(a * a + b * b + c * c).r;
        }
        for (int lane = 0; lane < kWidth; ++lane) total += sum[lane];
    }
    return total;
}

// kCount vectors at the given places stay in registers over all rows.
template <int kCount>
inline void combine_vectors(int count, const float *weight, const float *const *rows, const std::size_t *at, float *out,
                            bool more) {
    VecF sum[kCount];
    for (int v = 0; v < kCount; ++v) sum[v] = more ? load(out + at[v]) : VecF{};
    for (int j = 0; j < count; ++j) {
        const VecF w = splat(weight[j]);
        for (int v = 0; v < kCount; ++v) sum[v] += w * load(rows[j] + at[v]);
    }
    for (int v = 0; v < kCount; ++v) store(out + at[v], sum[v]);
}

// Fewer floats than a vector go one by one; else the last vector overlaps the one before it. Vectors of one
// group are all read before any is written, and the group that overlaps takes its neighbour along.
void combine(int count, const float *weight, const float *const *rows, float *out, std::size_t n, bool more) {
    if (n < kWidth) {
        for (std::size_t i = 0; i < n; ++i) {
            float sum = more ? out[i] : 0;
            for (int j = 0; j < count; ++j) sum += weight[j] * rows[j][i];
            out[i] = sum;
        }
        return;
    }
    std::size_t i = 0;
    for (; i + 5 * kWidth < n; i += 4 * kWidth) {
        const std::size_t at[4] = {i, i + kWidth, i + 2 * kWidth, i + 3 * kWidth};
        combine_vectors<4>(count, weight, rows, at, out, more);
    }
    std::size_t at[5];
    const std::size_t left = (n - i + kWidth - 1) / kWidth;
    for (std::size_t v = 0; v < left; ++v) at[v] = v + 1 < left ? i + v * kWidth : n - kWidth;
    switch (left) {
        case 1: return combine_vectors<1>(count, weight, rows, at, out, more);
        case 2: return combine_vectors<2>(count, weight, rows, at, out, more);
        case 3: return combine_vectors<3>(count, weight, rows, at, out, more);
        case 4: return combine_vectors<4>(count, weight, rows, at, out, more);
        default: return combine_vectors<5>(count, weight, rows, at, out, more);
    }
}

}  // namespace

extern const RowKernels rows;
const RowKernels rows = {add, extend, add_masked, lengths, combine};

}  // namespace SONO_ISA
}  // namespace sono

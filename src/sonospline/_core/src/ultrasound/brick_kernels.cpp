// Compiled once per instruction set (SONO_ISA names it), like kernels.cpp. Plain loops: compilers make vectors of them.
#include "ultrasound/brick_kernels.hpp"

#include <algorithm>
#include <cmath>

namespace sono {
namespace SONO_ISA {
namespace {

void place(const BeamScope &b, const double m[12], const Brick &brick, double (*local)[kMostInBrick], double *range,
           std::uint8_t *heard) {
    for (int a = 0; a < 3; ++a) {
        const float *from = brick.places[a];
        const float flip = brick.flip[a], sign = brick.sign[a];
        const double index = brick.index[a], side = brick.side;
        double *to = local[a];
        for (std::size_t n = 0; n < brick.count; ++n) to[n] = (index + static_cast<double>(flip + sign * from[n])) * side;
    }
    const double *u = local[0], *v = local[1], *w = local[2];
    const double nearest = -b.slack - 1, farthest = b.depth + b.slack + 1;
    for (std::size_t n = 0; n < brick.count; ++n) {
        const double x = m[0] * u[n] + m[1] * v[n] + m[2] * w[n] + m[3];
        const double y = m[4] * u[n] + m[5] * v[n] + m[6] * w[n] + m[7] + b.apex;
        const double z = m[8] * u[n] + m[9] * v[n] + m[10] * w[n] + m[11];
        const double r = (b.curved ? std::sqrt(x * x + y * y) : y) - b.apex;
        const double beside = std::fabs(x) * b.cos - y * b.sin - b.half_width;
        const double beyond = std::fabs(z) - b.slack, away = std::min(std::fabs(r - b.focus) + b.slack, 2 * b.depth);
        const double most = b.cut_squared * (b.variance + b.spread_squared * away * away);
        range[n] = r;
        heard[n] = (r > nearest) & (r < farthest) & (beside < b.slack + b.beside) &
                   ((beyond <= 0) | (beyond * beyond < most));
    }
}

void assign(const BeamScope &b, const Lattices &lattices, std::uint64_t key, const std::int32_t *number,
            std::size_t count, const double (*local)[kMostInBrick], const double *range, std::int64_t *voxel,
            double *weight, std::int32_t (*cell)[kMostInBrick], std::int32_t (*place)[kMostInBrick]) {
    for (std::size_t i = 0; i < count; ++i) {
        const double r = std::min(std::max(range[i], 0.0), b.depth), away = r - b.focus;
        const double sigma = std::sqrt(b.variance + b.spread_squared * away * away);
        weight[i] = std::sqrt(b.cell_mm2 * std::max(b.f_number, r / b.aperture) * sigma);
    }
    // nearest voxel of a place off by up to half a voxel: a finer probe would show the voxels
    const double *size = lattices.shape;
    for (std::size_t i = 0; i < count; ++i) {
        std::uint64_t bits = (key + static_cast<std::uint64_t>(number[i])) * 0x9E3779B97F4A7C15u;
        bits = (bits ^ (bits >> 29)) * 0xBF58476D1CE4E5B9u;
        double at[3];
        for (int a = 0; a < 3; ++a) {
            const auto off = static_cast<double>(static_cast<std::int32_t>(bits >> (16 + 16 * a) & 0xFFFF));
            at[a] = std::floor(local[a][i] * lattices.voxels_per_mm[a] + off / 65536);
        }
        const bool inside = (at[0] >= 0) & (at[0] < size[0]) & (at[1] >= 0) & (at[1] < size[1]) & (at[2] >= 0) & (at[2] < size[2]);
        voxel[i] = inside ? static_cast<std::int64_t>((at[0] * size[1] + at[1]) * size[2] + at[2]) : -1;
    }
    for (int a = 0; a < 3; ++a) {
        const double *m = lattices.to_cell + 4 * a;
        for (std::size_t i = 0; i < count; ++i) {
            const double index = m[0] * local[0][i] + m[1] * local[1][i] + m[2] * local[2][i] + m[3];
            // beyond any lattice, or no number: a cell that is none, and any place in it
            const double whole = std::min(std::max(-kFarCell, std::floor(index)), kFarCell);
            cell[a][i] = static_cast<std::int32_t>(whole);
            place[a][i] = static_cast<std::int32_t>(std::max(0.0, std::min(65535.0, (index - whole) * 65536)));
        }
    }
}

void smooth(const float *from, std::ptrdiff_t apart, const double *weights, std::ptrdiff_t radius, std::ptrdiff_t count,
            float *to) {
    constexpr std::ptrdiff_t kAtOnce = 64;  // sums that stay in registers or the first cache
    double sum[kAtOnce];
    for (std::ptrdiff_t first = 0; first < count; first += kAtOnce) {
        const std::ptrdiff_t n = std::min(kAtOnce, count - first);
        const float *middle = from + first;
        for (std::ptrdiff_t k = 0; k < n; ++k) sum[k] = weights[0] * static_cast<double>(middle[k]);
        for (std::ptrdiff_t s = radius; s > 0; --s) {
            const float *before = middle - s * apart, *after = middle + s * apart;
            for (std::ptrdiff_t k = 0; k < n; ++k)
                sum[k] += weights[s] * (static_cast<double>(before[k]) + static_cast<double>(after[k]));
        }
        for (std::ptrdiff_t k = 0; k < n; ++k) to[first + k] = static_cast<float>(sum[k]);
    }
}

}  // namespace

extern const BrickKernels brick_kernels;
const BrickKernels brick_kernels = {place, assign, smooth};

}  // namespace SONO_ISA
}  // namespace sono

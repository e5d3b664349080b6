#include "elasticity/elastic_load.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "common/require.hpp"
#include "common/row_kernels.hpp"

namespace sono {
namespace {

constexpr double kReach = 5.2;  // in widths: 2e-7 of a Gaussian lies beyond
constexpr std::size_t kSmall = 40'000;  // nodes up to which one thread is faster

struct Axis {
    std::size_t nodes;
    double spacing, width;
    bool low_mirrored, high_mirrored;
};

/// Integrals of a Gaussian times the hat functions of the nodes of an axis: [first, end) of them are not zero.
struct Share {
    std::size_t first, end;
    float *weights;
};

double passed(double z) { return 0.5 * std::erfc(-z / std::sqrt(2.0)); }

/// Second integral of a Gaussian of width 1, whose second difference is the integral times a hat function: by Taylor's
/// series about the nearest of places a sixteenth apart, to 2e-12.
class Ramp {
  public:
    Ramp() {
        for (int i = 0; i <= 2 * kEnd * kAWidth; ++i) {
            const double z = place(i), density = std::exp(-0.5 * z * z) / std::sqrt(2 * std::acos(-1.0));
            known_[static_cast<std::size_t>(i)] = {z * passed(z) + density, passed(z), density};
        }
    }
    double operator()(double z) const {
        if (!(std::abs(z) < kEnd)) return std::max(z, 0.0);
        const int i = static_cast<int>((z + kEnd) * kAWidth + 0.5);
        const auto [ramp, slope, density] = known_[static_cast<std::size_t>(i)];
        const double at = place(i), d = z - at, square = at * at;
        const double curved = 0.5 - d * (at / 6 - d * ((square - 1) / 24 + d * at * (3 - square) / 120));
        return ramp + d * (slope + d * density * curved);
    }

  private:
    static constexpr int kEnd = 8, kAWidth = 16;
    struct Known {
        double ramp, slope, density;
    };
    static double place(int i) { return static_cast<double>(i) / kAWidth - kEnd; }
    std::array<Known, 2 * kEnd * kAWidth + 1> known_;
};

const Ramp ramp;

/// Adds what of a Gaussian at a place lies within the axis; on its ends half a hat is beyond.
void add_within(double at, const Axis &axis, Share &share) {
    const auto last = static_cast<double>(axis.nodes - 1);
    const double h = axis.spacing, a = axis.width, reach = kReach * a;
    if (at + reach < 0 || at - reach > last * h) return;
    const auto first = whole_within<std::size_t>((at - reach) / h, 0.0, last);
    const auto end = whole_within<std::size_t>(std::ceil((at + reach) / h), 0.0, last) + 1;
    const auto z = [&](double node) { return (node * h - at) / a; };
    const auto slope = [&](double low, double high) { return (high - low) * (a / h); };
    double here = ramp(z(static_cast<double>(first)));
    double before = first == 0 ? passed(z(0)) : slope(ramp(z(static_cast<double>(first) - 1)), here);
    for (std::size_t i = first; i < end; ++i) {
        const bool at_end = i + 1 == axis.nodes;
        const double next = at_end ? here : ramp(z(static_cast<double>(i) + 1));
        const double after = at_end ? passed(z(last)) : slope(here, next);
        share.weights[i] += static_cast<float>(after - before);
        here = next, before = after;
    }
    share.first = std::min(share.first, first), share.end = std::max(share.end, end);
}

Share share_of(double at, const Axis &axis, float *weights) {
    std::fill_n(weights, axis.nodes, 0.f);
    Share share{axis.nodes, 0, weights};
    add_within(at, axis, share);
    if (axis.low_mirrored) add_within(-at, axis, share);
    if (axis.high_mirrored) add_within(2 * static_cast<double>(axis.nodes - 1) * axis.spacing - at, axis, share);
    return share;
}

/// Of each point the shares of the nodes of every axis.
class Shares {
  public:
    Shares(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing, const SmoothedPoints &points)
        : shares_(points.count), weights_(points.count * (shape[0] + shape[1] + shape[2])) {
        float *at = weights_.data();
        for (std::size_t p = 0; p < points.count; ++p)
            for (std::size_t a = 0; a < 3; at += shape[a], ++a) {
                const Axis axis{shape[a], spacing[a], points.width, points.mirrored[2 * a], points.mirrored[2 * a + 1]};
                shares_[p][a] = share_of(points.places[3 * p + a], axis, at);
            }
    }
    const std::array<Share, 3> &operator[](std::size_t point) const { return shares_[point]; }

  private:
    std::vector<std::array<Share, 3>> shares_;
    std::vector<float> weights_;
};

/// Of each point the shares of the nodes of a plane, in one piece from its first line to its last: short rows take as long.
class Patches {
  public:
    struct Patch {
        std::size_t first, count;
        const float *weights;
    };
    Patches(const Shares &shares, std::size_t points, std::size_t line) : patches_(points) {
        std::size_t all = 0;
        for (std::size_t p = 0; p < points; ++p) {
            const Share &y = shares[p][1], &z = shares[p][2];
            if (y.first >= y.end || z.first >= z.end) continue;
            patches_[p] = {y.first * line + z.first, (y.end - 1 - y.first) * line + z.end - z.first, nullptr};
            all += patches_[p].count;
        }
        weights_.resize(all);
        float *at = weights_.data();
        for (std::size_t p = 0; p < points; at += patches_[p++].count) {
            const Share &y = shares[p][1], &z = shares[p][2];
            patches_[p].weights = at;
            if (!patches_[p].count) continue;
            for (std::size_t j = y.first; j < y.end; ++j)
                for (std::size_t k = z.first; k < z.end; ++k)
                    at[(j - y.first) * line + k - z.first] = y.weights[j] * z.weights[k];
        }
    }
    const Patch &operator[](std::size_t point) const { return patches_[point]; }

  private:
    std::vector<Patch> patches_;
    std::vector<float> weights_;
};

/// Adds points to fields (components, nx, ny, nz), each times its scale(point, component).
template <class Scale>
void add_points(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                const SmoothedPoints &points, std::size_t components, Scale scale, float *out) {
    const Shares shares(shape, spacing, points);
    const Patches patches(shares, points.count, shape[2]);
    const std::size_t plane = shape[1] * shape[2], size = shape[0] * plane;
    const std::size_t planes = size > kSmall ? 1 : shape[0];
    // Points are added in their order at every node, whatever thread has its plane.
    parallel_for((shape[0] + planes - 1) / planes, [&](std::size_t block) {
        const std::size_t begin = block * planes, end = std::min(begin + planes, shape[0]);
        for (std::size_t a = 0; a < components; ++a) std::fill(out + a * size + begin * plane, out + a * size + end * plane, 0.f);
        for (std::size_t p = 0; p < points.count; ++p) {
            const Share &x = shares[p][0];
            const auto [first, count, weights] = patches[p];
            for (std::size_t i = std::max(begin, x.first); i < std::min(end, x.end); ++i)
                for (std::size_t a = 0; a < components; ++a)
                    kernels().rows->add(static_cast<float>(scale(p, a)) * x.weights[i], weights,
                                        out + a * size + i * plane + first, count);
        }
    });
}

}  // namespace

void nodal_forces(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                  const SmoothedPoints &points, const double *amounts, const std::array<double, 3> &direction,
                  float *out) {
    add_points(shape, spacing, points, 1, [&](std::size_t p, std::size_t) { return amounts[p]; }, out);
    const std::size_t size = shape[0] * shape[1] * shape[2];
    float *const __restrict__ x = out, *const __restrict__ y = out + size, *const __restrict__ z = out + 2 * size;
    const float along[3] = {float(direction[0]), float(direction[1]), float(direction[2])};
    for (std::size_t i = 0; i < size; ++i) {
        const float amount = x[i];
        x[i] = along[0] * amount, y[i] = along[1] * amount, z[i] = along[2] * amount;
    }
}

void nodal_force_vectors(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                         const SmoothedPoints &points, const double *forces, float *out) {
    add_points(shape, spacing, points, 3, [&](std::size_t p, std::size_t a) { return forces[3 * p + a]; }, out);
}

}  // namespace sono

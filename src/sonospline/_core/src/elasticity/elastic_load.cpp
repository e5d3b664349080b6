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

/// Second integral of a Gaussian of width 1: its second difference is the integral times a hat function.
double ramp(double z) { return z * passed(z) + std::exp(-0.5 * z * z) / std::sqrt(2 * std::acos(-1.0)); }

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

/// Calls visit(point, begin of the row, weights of its plane and line, share along it) for every row of [begin, end)
/// planes that a point reaches.
template <class Visit>
void each_row(const Shares &shares, std::size_t count, std::size_t begin, std::size_t end,
              const std::array<std::size_t, 3> &shape, Visit visit) {
    for (std::size_t p = 0; p < count; ++p) {
        const auto &[x, y, z] = shares[p];
        if (z.first >= z.end) continue;
        for (std::size_t i = std::max(begin, x.first); i < std::min(end, x.end); ++i)
            for (std::size_t j = y.first; j < y.end; ++j)
                visit(p, (i * shape[1] + j) * shape[2] + z.first, x.weights[i], y.weights[j], z);
    }
}

}  // namespace

void nodal_forces(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                  const SmoothedPoints &points, const double *amounts, const std::array<double, 3> &direction,
                  float *out) {
    const Shares shares(shape, spacing, points);
    const std::size_t plane = shape[1] * shape[2], size = shape[0] * plane;
    const std::size_t planes = size > kSmall ? 1 : shape[0];
    // Points are added in their order at every node, whatever thread has its plane.
    parallel_for((shape[0] + planes - 1) / planes, [&](std::size_t block) {
        const std::size_t begin = block * planes, end = std::min(begin + planes, shape[0]);
        std::fill(out + begin * plane, out + end * plane, 0.f);
        each_row(shares, points.count, begin, end, shape,
                 [&](std::size_t p, std::size_t at, float across, float weight, const Share &z) {
                     const auto amount = static_cast<float>(amounts[p]);
                     kernels().rows->add(amount * across * weight, z.weights + z.first, out + at, z.end - z.first);
                 });
    });
    for (std::size_t a = 3; a-- > 0;)
        for (std::size_t i = 0; i < size; ++i) out[a * size + i] = static_cast<float>(direction[a]) * out[i];
}

void nodal_force_vectors(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                         const SmoothedPoints &points, const double *forces, float *out) {
    const Shares shares(shape, spacing, points);
    const Patches patches(shares, points.count, shape[2]);
    const std::size_t plane = shape[1] * shape[2], size = shape[0] * plane;
    const std::size_t planes = size > kSmall ? 1 : shape[0];
    parallel_for((shape[0] + planes - 1) / planes, [&](std::size_t block) {
        const std::size_t begin = block * planes, end = std::min(begin + planes, shape[0]);
        for (std::size_t a = 0; a < 3; ++a) std::fill(out + a * size + begin * plane, out + a * size + end * plane, 0.f);
        for (std::size_t p = 0; p < points.count; ++p) {
            const Share &x = shares[p][0];
            const auto [first, count, weights] = patches[p];
            for (std::size_t i = std::max(begin, x.first); i < std::min(end, x.end); ++i)
                for (std::size_t a = 0; a < 3; ++a)
                    kernels().rows->add(static_cast<float>(forces[3 * p + a]) * x.weights[i], weights,
                                        out + a * size + i * plane + first, count);
        }
    });
}

}  // namespace sono

#include "elasticity/elastic_inverse.hpp"

#include <algorithm>
#include <cmath>

#include "common/require.hpp"

namespace sono {
namespace {

using Point = std::array<double, 3>;

constexpr int kUndamped = 8;
constexpr double kTolerance = 3e-6;  // of the shortest spacing
constexpr std::ptrdiff_t kReach = 4;  // nodes on either side of a cell; beyond, a value counts for a thousandth
constexpr std::size_t kWindow = 2 * kReach + 2;

/// The nodes around a place on an axis, and what the value of each counts for in the spline there.
struct Window {
    std::size_t first, count;
    float weights[kWindow];
};

Window window(double place, std::size_t nodes, const double *filter) {
    const auto cell = whole_within<std::ptrdiff_t>(place, 0.0, static_cast<double>(nodes - 2));
    const double t = place - static_cast<double>(cell), s = 1 - t;
    const double bumps[4] = {s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
                             (3 * s * s * s - 6 * s * s + 4) / 6, t * t * t / 6};
    Window w{static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, cell - kReach)), 0, {}};
    w.count = std::min(nodes, static_cast<std::size_t>(cell + kReach) + 2) - w.first;
    for (std::size_t j = 0; j < w.count; ++j) {
        double sum = 0;
        for (std::size_t i = 0; i < 4; ++i) sum += bumps[i] * filter[(static_cast<std::size_t>(cell) + i) * nodes + w.first + j];
        w.weights[j] = static_cast<float>(sum);
    }
    return w;
}

Point displacement(const NodalSpline &u, const Point &at) {
    const auto &n = u.shape;
    Window w[3];
    for (std::size_t a = 0; a < 3; ++a) w[a] = window(at[a] / u.spacing[a], n[a], u.filters[a]);
    Point sum{};
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t i = 0; i < w[0].count; ++i) {
            float along[kWindow] = {};
            for (std::size_t j = 0; j < w[1].count; ++j) {
                const float *const row = u.values + ((a * n[0] + w[0].first + i) * n[1] + w[1].first + j) * n[2] + w[2].first;
                for (std::size_t k = 0; k < w[2].count; ++k) along[k] += w[1].weights[j] * row[k];
            }
            float total = 0;
            for (std::size_t k = 0; k < w[2].count; ++k) total += w[2].weights[k] * along[k];
            sum[a] += static_cast<double>(w[0].weights[i] * total);
        }
    return sum;
}

double within(const NodalSpline &u, double x, std::size_t axis) {
    return std::clamp(x, 0.0, static_cast<double>(u.shape[axis] - 1) * u.spacing[axis]);
}

Point undeformed(const NodalSpline &u, const Point &point, Point x, int iterations) {
    const double enough = kTolerance * *std::min_element(u.spacing.begin(), u.spacing.end());
    for (std::size_t a = 0; a < 3; ++a) x[a] = within(u, x[a], a);
    for (int iteration = 0; iteration < iterations; ++iteration) {
        const Point moves = displacement(u, x);
        // Where u falls by more than its own length the plain iteration would swing about the solution.
        const double share = iteration < kUndamped ? 1.0 : 0.5;
        double moved = 0;
        for (std::size_t a = 0; a < 3; ++a) {
            const double change = within(u, point[a] - moves[a], a) - x[a];
            x[a] += share * change;
            moved = std::max(moved, std::abs(change));
        }
        if (!(moved > enough)) break;
    }
    return x;
}

}  // namespace

void undeformed_points(const NodalSpline &u, const double *points, int iterations, std::size_t count, double *places) {
    for (std::size_t p = 0; p < 3 * count; p += 3) {
        const Point x = undeformed(u, {points[p], points[p + 1], points[p + 2]}, {places[p], places[p + 1], places[p + 2]},
                                   iterations);
        std::copy(x.begin(), x.end(), places + p);
    }
}

void displacement_at(const NodalSpline &u, const double *points, std::size_t count, double *out) {
    for (std::size_t p = 0; p < 3 * count; p += 3) {
        const Point here = displacement(u, {within(u, points[p], 0), within(u, points[p + 1], 1), within(u, points[p + 2], 2)});
        std::copy(here.begin(), here.end(), out + p);
    }
}

}  // namespace sono

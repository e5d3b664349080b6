#include "sampling.hpp"

#include <algorithm>

#include "parallel.hpp"
#include "trilinear.hpp"

namespace sono {
namespace {

constexpr std::size_t kPointsPerBlock = 2048;

template <class Body> void over_points(std::size_t m, const Body &body) {
    const std::size_t blocks = (m + kPointsPerBlock - 1) / kPointsPerBlock;
    parallel_for(blocks, [&](std::size_t block) {
        const std::size_t end = std::min(m, (block + 1) * kPointsPerBlock);
        for (std::size_t i = block * kPointsPerBlock; i < end; ++i) body(i);
    });
}

}  // namespace

void sample_lattice(const LatticeField &field, const double *points, std::size_t m, double *out) {
    const Trilinear<double> sample(field);
    over_points(m, [&](std::size_t i) { sample(points + 3 * i, out + 3 * i); });
}

void invert_lattice(const LatticeField &field, const double *points, std::size_t m, double tolerance, int most,
                    double *out, std::int32_t *iterations) {
    const Trilinear<double> sample(field);
    over_points(m, [&](std::size_t i) {
        const double *p = points + 3 * i;
        double *x = out + 3 * i;
        std::copy_n(p, 3, x);
        iterations[i] = 0;
        for (int step = 1; step <= most; ++step) {
            double u[3], missing = 0;
            sample(x, u);
            for (int a = 0; a < 3; ++a) {
                const double d = p[a] - u[a] - x[a];
                missing += d * d;
                x[a] += d;
            }
            if (missing <= tolerance * tolerance) {
                iterations[i] = step;
                break;
            }
        }
    });
}

}  // namespace sono

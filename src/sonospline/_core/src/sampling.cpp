#include "sampling.hpp"

#include <algorithm>
#include <cmath>

#include "parallel.hpp"

namespace sono {
namespace {

constexpr std::size_t kPointsPerBlock = 2048;

class Sampler {
  public:
    explicit Sampler(const LatticeField &field)
        : values_(field.values), row_(3 * field.shape[2]), plane_(row_ * field.shape[1]) {
        for (int a = 0; a < 3; ++a) {
            inverse_[a] = 1 / field.spacing[a];
            last_[a] = static_cast<double>(field.shape[a] - 1);
            cells_[a] = static_cast<std::ptrdiff_t>(field.shape[a]) - 2;
        }
    }

    void operator()(const double p[3], double u[3]) const {
        std::ptrdiff_t cell[3];
        float t[3];
        for (int a = 0; a < 3; ++a) {
            const double index = std::min(std::max(p[a] * inverse_[a], 0.0), last_[a]);  // NaN goes to 0
            cell[a] = std::min(static_cast<std::ptrdiff_t>(index), cells_[a]);
            t[a] = static_cast<float>(index - static_cast<double>(cell[a]));
        }
        const float *corner = values_ + cell[0] * plane_ + cell[1] * row_ + cell[2] * 3;
        for (int c = 0; c < 3; ++c, ++corner) {
            const float low = face(corner, t), high = face(corner + plane_, t);
            u[c] = low + t[0] * (high - low);
        }
    }

  private:
    float face(const float *at, const float t[3]) const {
        const float low = at[0] + t[2] * (at[3] - at[0]);
        const float high = at[row_] + t[2] * (at[row_ + 3] - at[row_]);
        return low + t[1] * (high - low);
    }

    const float *values_;
    std::ptrdiff_t row_, plane_, cells_[3];
    double inverse_[3], last_[3];
};

template <class Body> void over_points(std::size_t m, const Body &body) {
    const std::size_t blocks = (m + kPointsPerBlock - 1) / kPointsPerBlock;
    parallel_for(blocks, [&](std::size_t block) {
        const std::size_t end = std::min(m, (block + 1) * kPointsPerBlock);
        for (std::size_t i = block * kPointsPerBlock; i < end; ++i) body(i);
    });
}

}  // namespace

void sample_lattice(const LatticeField &field, const double *points, std::size_t m, double *out) {
    const Sampler sample(field);
    over_points(m, [&](std::size_t i) { sample(points + 3 * i, out + 3 * i); });
}

void invert_lattice(const LatticeField &field, const double *points, std::size_t m, double tolerance, int most,
                    double *out, std::int32_t *iterations) {
    const Sampler sample(field);
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

#include "fields/sampling.hpp"

#include <algorithm>
#include <cmath>

#include "common/parallel.hpp"

namespace sono {
namespace {

constexpr std::size_t kPointsPerBlock = 2048;

class LinearSampler {
  public:
    explicit LinearSampler(const LatticeField &field)
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
            const double index = std::min(std::max(p[a] * inverse_[a], 0.0), last_[a]);  // NaN stays,
            cell[a] = std::min(static_cast<std::ptrdiff_t>(std::max(0.0, index)), cells_[a]);  // but here goes to 0
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

// Tensor products of cubic B-splines: 64 coefficients a point.
class CubicSampler {
  public:
    explicit CubicSampler(const LatticeField &field)
        : values_(field.values), row_(3 * field.shape[2]), plane_(row_ * field.shape[1]) {
        for (int a = 0; a < 3; ++a) {
            inverse_[a] = 1 / field.spacing[a];
            last_[a] = static_cast<double>(field.shape[a]) - 3;  // the last node's number
            cells_[a] = static_cast<std::ptrdiff_t>(field.shape[a]) - 4;
        }
    }

    void operator()(const double p[3], double u[3]) const {
        Place at = place(p);
        sum(at, at.weight[0], at.weight[1], at.weight[2], u);
    }

    void gradient(const double p[3], double out[9]) const {
        Place at = place(p);
        for (int b = 0; b < 3; ++b) {
            const float *weight[3] = {at.weight[0], at.weight[1], at.weight[2]};
            weight[b] = at.slope[b];
            double column[3];
            sum(at, weight[0], weight[1], weight[2], column);
            for (int a = 0; a < 3; ++a) out[3 * a + b] = column[a];
        }
    }

  private:
    struct Place {
        const float *corner;
        float weight[3][4], slope[3][4];
    };

    Place place(const double p[3]) const {
        Place at;
        std::ptrdiff_t cell[3];
        for (int a = 0; a < 3; ++a) {
            const double index = std::min(std::max(p[a] * inverse_[a], 0.0), last_[a]);  // NaN stays,
            cell[a] = std::min(static_cast<std::ptrdiff_t>(std::max(0.0, index)), cells_[a]);  // but here goes to 0
            const float t = static_cast<float>(index - static_cast<double>(cell[a])), s = 1 - t;
            const float w[4] = {s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
                                (3 * s * s * s - 6 * s * s + 4) / 6, t * t * t / 6};
            const float inside = p[a] * inverse_[a] == index ? static_cast<float>(inverse_[a]) : 0;  // constant beyond
            const float d[4] = {-s * s / 2, (3 * t - 4) * t / 2, -(3 * s - 4) * s / 2, t * t / 2};
            for (int j = 0; j < 4; ++j) at.weight[a][j] = w[j], at.slope[a][j] = inside * d[j];
        }
        at.corner = values_ + cell[0] * plane_ + cell[1] * row_ + cell[2] * 3;
        return at;
    }

    void sum(const Place &at, const float *x, const float *y, const float *z, double u[3]) const {
        float total[3] = {};
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < 4; ++j) {
                const float *const c = at.corner + i * plane_ + j * row_;
                const float xy = x[i] * y[j];
                for (int a = 0; a < 3; ++a)
                    total[a] += xy * (z[0] * c[a] + z[1] * c[a + 3] + z[2] * c[a + 6] + z[3] * c[a + 9]);
            }
        for (int a = 0; a < 3; ++a) u[a] = total[a];
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

template <class Sampler>
void invert(const Sampler &sample, const double *points, std::size_t m, double tolerance, int most, double *out,
            std::int32_t *iterations) {
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

template <class Body> void with_sampler(const LatticeField &field, const Body &body) {
    field.order == 3 ? body(CubicSampler(field)) : body(LinearSampler(field));
}

}  // namespace

void sample_lattice(const LatticeField &field, const double *points, std::size_t m, double *out) {
    with_sampler(field, [&](const auto &sample) {
        over_points(m, [&](std::size_t i) { sample(points + 3 * i, out + 3 * i); });
    });
}

void gradient_lattice(const LatticeField &field, const double *points, std::size_t m, double *out) {
    const CubicSampler sample(field);
    over_points(m, [&](std::size_t i) { sample.gradient(points + 3 * i, out + 9 * i); });
}

void invert_lattice(const LatticeField &field, const double *points, std::size_t m, double tolerance, int most,
                    double *out, std::int32_t *iterations) {
    with_sampler(field,
                 [&](const auto &sample) { invert(sample, points, m, tolerance, most, out, iterations); });
}

}  // namespace sono

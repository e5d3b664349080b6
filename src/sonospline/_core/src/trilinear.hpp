// The displacement between the nodes of a lattice, for coordinates of type T.
#pragma once

#include <algorithm>
#include <cstddef>

#include "sampling.hpp"

namespace sono {

template <class T> class Trilinear {
  public:
    explicit Trilinear(const LatticeField &field)
        : values_(field.values), row_(3 * field.shape[2]), plane_(row_ * field.shape[1]) {
        for (int a = 0; a < 3; ++a) {
            inverse_[a] = static_cast<T>(1 / field.spacing[a]);
            last_[a] = static_cast<T>(field.shape[a] - 1);
            cells_[a] = static_cast<std::ptrdiff_t>(field.shape[a]) - 2;
        }
    }

    /// u at p, lengths along the lattice axes from node 0; beyond the lattice, at its nearest point.
    void operator()(const T p[3], T u[3]) const {
        std::ptrdiff_t cell[3];
        float t[3];
        for (int a = 0; a < 3; ++a) {
            const T index = std::min(std::max(p[a] * inverse_[a], T(0)), last_[a]);  // NaN goes to 0
            cell[a] = std::min(static_cast<std::ptrdiff_t>(index), cells_[a]);
            t[a] = static_cast<float>(index - static_cast<T>(cell[a]));
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
    T inverse_[3], last_[3];
};

}  // namespace sono

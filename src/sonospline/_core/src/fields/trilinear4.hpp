// The displacement between the nodes of a lattice in single precision, x y z in one vector of four.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "fields/sampling.hpp"

namespace sono {

typedef float Float4 __attribute__((vector_size(16)));
typedef std::int32_t Int4 __attribute__((vector_size(16)));

inline Float4 load4(const float *from) {
    Float4 v;
    std::memcpy(&v, from, sizeof v);
    return v;
}

/// Positions are lengths along the lattice axes from node 0, in lanes 0 to 2; lane 3 is 0.
class Trilinear4 {
  public:
    explicit Trilinear4(const LatticeField &field)
        : values_(field.values), row_(3 * static_cast<std::ptrdiff_t>(field.shape[2])),
          plane_(row_ * static_cast<std::ptrdiff_t>(field.shape[1])) {
        for (int a = 0; a < 3; ++a) {
            inverse_[a] = static_cast<float>(1 / field.spacing[a]);
            last_[a] = static_cast<float>(field.shape[a] - 1);
            cells_[a] = static_cast<std::int32_t>(field.shape[a]) - 2;
        }
    }

    /// u at p; beyond the lattice, at its nearest point.
    Float4 operator()(Float4 p) const {
        Float4 index = p * inverse_;
        index = index > 0.0f ? index : Float4{};  // NaN goes to 0
        index = index < last_ ? index : last_;
        Int4 cell = __builtin_convertvector(index, Int4);
        cell = cell < cells_ ? cell : cells_;
        const Float4 t = index - __builtin_convertvector(cell, Float4);
        // rows of six floats: two nodes along z; loaded twice, so that nothing beyond them is read
        const float *r00 = values_ + cell[0] * plane_ + cell[1] * row_ + cell[2] * 3, *r10 = r00 + plane_;
        const float *r01 = r00 + row_, *r11 = r10 + row_;
        const float x = t[0], y = t[1], xy = x * y, x0 = x - xy, y0 = y - xy, none = 1 - x - y0;
        const Float4 low = none * load4(r00) + x0 * load4(r10) + y0 * load4(r01) + xy * load4(r11);
        const Float4 high = none * load4(r00 + 2) + x0 * load4(r10 + 2) + y0 * load4(r01 + 2) + xy * load4(r11 + 2);
        const Float4 above = __builtin_shufflevector(high, high, 1, 2, 3, 3);
        return (low + t[2] * (above - low)) * Float4{1, 1, 1, 0};
    }

  private:
    const float *values_;
    std::ptrdiff_t row_, plane_;
    Float4 inverse_{}, last_{};
    Int4 cells_{};
};

}  // namespace sono

// The nodal load of a line force, with the consistent mass of trilinear elements.
#pragma once

#include <array>
#include <cstddef>

namespace sono {

/// A force along a line through `origin` that changes by changes[i] per length at places[i], and a force `tip` at
/// `depth`; smoothed by a Gaussian of `width`.
struct AxialForce {
    std::array<double, 3> origin, direction;
    const double *places, *changes;
    std::size_t count;
    double depth, tip, width;
};

/// out (3, nx, ny, nz) = M b for that force per volume b.
void line_load(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing, const AxialForce &force,
               float *out);

}  // namespace sono

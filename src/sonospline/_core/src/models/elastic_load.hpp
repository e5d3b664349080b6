// The nodal load of a line force on trilinear elements.
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

/// out (3, nx, ny, nz): integrals of that force per volume times the hat functions of the nodes.
void line_load(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing, const AxialForce &force,
               float *out);

}  // namespace sono

// The nodal load of forces at points on trilinear elements.
#pragma once

#include <array>
#include <cstddef>

namespace sono {

/// Points, places[3 i] from the first node, each smoothed by a Gaussian of `width`. What lies beyond a face
/// (x-, x+, y-, y+, z-, z+) that is `mirrored` is brought back by a mirror there; what lies beyond another is lost.
struct SmoothedPoints {
    const double *places;
    std::size_t count;
    double width;
    std::array<bool, 6> mirrored;
};

/// out (3, nx, ny, nz): integrals of forces along one direction, amounts[i] at each point, per volume times the hat
/// functions of the nodes, in closed form.
void nodal_forces(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                  const SmoothedPoints &points, const double *amounts, const std::array<double, 3> &direction, float *out);

/// The same of forces (count, 3), each along its own direction.
void nodal_force_vectors(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
                         const SmoothedPoints &points, const double *forces, float *out);

}  // namespace sono

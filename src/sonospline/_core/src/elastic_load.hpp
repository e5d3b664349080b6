// The nodal load of a line force, with the consistent mass of trilinear elements.
#pragma once

#include <array>
#include <cstddef>

namespace sono {

/// out (3, nx, ny, nz) = M b for the force per volume b(p) = direction profile(tau) e^(-d^2 / 2 width^2), with tau
/// and d the place along and the distance from a line through `origin`. profile[i] is at first + i interval.
void line_load(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
               const std::array<double, 3> &origin, const std::array<double, 3> &direction,
               const float *profile, std::size_t count, double first, double interval, double width, float *out);

}  // namespace sono

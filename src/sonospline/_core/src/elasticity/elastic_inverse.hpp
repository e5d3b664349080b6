// The displacement of the solver's nodes between them, and where points of deformed tissue were before.
#pragma once

#include <array>
#include <cstddef>

namespace sono {

/// A displacement (3, nx, ny, nz), a cubic spline between its nodes.
struct NodalSpline {
    std::array<std::size_t, 3> shape;
    std::array<double, 3> spacing;
    const float *values;
    std::array<const double *, 3> filters;  // of each axis (n + 2, n): from values at nodes to B-spline coefficients
};

/// places (count, 3): the x in the box with x + u(x) = points, by at most so many iterations from what it holds; of points
/// that no tissue of the box is at, near ones on its faces.
void undeformed_points(const NodalSpline &u, const double *points, int iterations, std::size_t count, double *places);

/// out (count, 3): u at points; of those beyond the box, at its faces.
void displacement_at(const NodalSpline &u, const double *points, std::size_t count, double *out);

}  // namespace sono

// A displacement known at lattice nodes, linear between them or a cubic spline: sampled
// at any points, and inverted there. Coordinates are lengths along the lattice axes from node 0.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace sono {

struct LatticeField {
    // (nx, ny, nz, 3) along the lattice axes: values at the nodes (order 1), or the coefficients of
    // cubic B-splines (order 3), of which there is one more on every side.
    const float *values;
    std::array<std::size_t, 3> shape;  // of the array
    std::array<double, 3> spacing;
    int order;
};

/// out (m, 3) = field at points (m, 3); beyond the lattice, the value at its nearest point.
void sample_lattice(const LatticeField &field, const double *points, std::size_t m, double *out);

/// out (m, 3, 3) = d u_a / d x_b of a field of order 3 at points (m, 3).
void gradient_lattice(const LatticeField &field, const double *points, std::size_t m, double *out);

/// Solves x + u(x) = p for each of m points by x <- p - u(x): out (m, 3), and the iterations
/// it took (0 where it did not come within `tolerance` in `most`).
void invert_lattice(const LatticeField &field, const double *points, std::size_t m, double tolerance, int most,
                    double *out, std::int32_t *iterations);

}  // namespace sono

// Kernel sums over many points: tiles are filled, summed and written back by a
// thread team. The affine part a0 + x A is the starting value of each point.
#pragma once

#include <array>
#include <cstddef>

#include "common/kernels.hpp"

namespace sono {

struct KernelSum {
    Kernel kernel;
    const double *centres;  // (n, 3)
    const double *weights;  // (n, 3)
    std::size_t count;
    const double *affine;  // (4, 3): row 0 is a0, rows 1 to 3 multiply x, y, z
};

/// out (m, 3) = affine + kernel sum at points (m, 3)
template <class T>
void sum_at_points(const KernelSum &sum, const double *points, std::size_t m, T *out);

/// out (nx, ny, nz, 3), nodes at (i hx, j hy, k hz)
template <class T>
void sum_on_lattice(const KernelSum &sum, const std::array<std::size_t, 3> &shape,
                    const std::array<double, 3> &spacing, T *out);

/// out (m, 3, 3): derivative of component a along axis b, affine part included
void gradient_at_points(const KernelSum &sum, const double *points, std::size_t m, double *out);

/// out (m, 3) = sum over centres (n, 3) of K(p - c_j) f_j, forces f (n, 3)
void kelvinlet_sum(const Kelvinlet &kernel, const double *points, std::size_t m, const double *centres,
                   const double *forces, std::size_t n, double *out);

/// out (m, n) = U(|p_i - c_j|)
void kernel_matrix(Kernel kernel, const double *points, std::size_t m, const double *centres, std::size_t n,
                   double *out);

}  // namespace sono

// Forces of contact: within bounds, and such that points are where they are to be.
#pragma once

#include <cstddef>

namespace sono {

/// n points: compliance (n, n) is symmetric, its diagonal above zero; apart[i] says how far a point is beyond where it is
/// to be without any force.
struct Contact {
    const double *compliance, *apart, *low, *high;
    std::size_t n;
};

/// Projected Gauss-Seidel on forces (n,), which hold where to begin; beyond (n,) gets apart + compliance forces. Returns
/// the sweeps taken: `most`, or as many as it takes until none moves a point by more than `tolerance`.
int clipped_forces(const Contact &contact, double *forces, double *beyond, int most, double tolerance);

}  // namespace sono

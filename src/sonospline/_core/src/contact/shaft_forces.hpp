// Forces between a shaft and tissue: friction along it, and what holds it sideways.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sono {

/// m points of tissue along a shaft, seen along its axis.
struct ShaftPoints {
    const double *compliance;     // (m, m), symmetric
    const double *behind;         // (m,): how far behind the tip the needle is at each of them, under the forces of before
    const double *end;            // (m,): their share in the point that the tip is at
    const double *bond;           // (m + 1,): how far a force moves a point along the shaft that it sticks to; the tip's last
    const double *bounds;         // (m,): of friction
    const std::uint8_t *sliding;  // (m,)
    std::size_t count;
    double limit;                 // of the tip's force
};

/// How the forces are sought: each change of one is held back as if its point gave way by `slow` of its own less.
struct Search {
    double slow;
    int sweeps;
    double tolerance;
};

/// Finds axial (m,), anchors (m,) and the tip's force, which hold those of before; returns how far tissue is ahead of the tip.
double stick_slip(const ShaftPoints &shaft, const Search &search, double *axial, double *anchors, double &tip);

/// n of m points, a compliance (3 m, 3 m) of all of them, symmetric, and two axes (2, 3) across a shaft.
struct HeldPoints {
    const double *compliance, *axes;
    const std::size_t *held;
    std::size_t count, of;
    double soft;  // of a point's own compliance, in which it gives way to the shaft
    double least;
};

/// The forces (n, 3) across the shaft that move points by `wanted` (n, 3).
void forces_across(const HeldPoints &points, const double *wanted, double *forces);

}  // namespace sono

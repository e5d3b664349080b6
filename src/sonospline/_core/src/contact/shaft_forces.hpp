// Forces between a shaft and tissue: friction along it, and what holds it sideways.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sono {

/// m points of tissue along a shaft, seen along its axis.
struct ShaftPoints {
    const double *compliance;     // (m, m), symmetric
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

/// Finds axial (m,), anchors (m,), the tip's force, and how far behind the tip the needle is at each point, which all hold
/// those of before.
void stick_slip(const ShaftPoints &shaft, const Search &search, double *behind, double *axial, double *anchors,
                double &tip);

/// m points, n of which a shaft holds, a compliance (3 m, 3 m) of all of them, symmetric, and its axis, a unit vector.
struct HeldPoints {
    const double *compliance, *places, *axis;
    const std::uint8_t *held;  // (m,)
    std::size_t count, of;
    double share, bond, soft, least;
};

/// Finds the forces (m, 3) across the shaft, and how far beside it points are to be; both hold those of before.
void held_across(const HeldPoints &points, double *offsets, double *lateral);

}  // namespace sono

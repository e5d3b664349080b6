// The track of a needle: points that stick to its shaft or slip, and a tip that cuts on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "contact/shaft_forces.hpp"

namespace sono {

/// m points of a track and what resists there, as the twin of cut_on has it.
struct TrackPoints {
    const double *compliance;  // (m, m)
    const double *bond;        // (m + 1,)
    const double *resistance;  // (4, m)
    std::size_t count;
    double apart, reuse, speed;
    double membrane, rupture;
};

/// When forces are found well enough.
struct Enough {
    Search search;
    double ends, grown;
    int most;
};

/// What changes: of the points (m,) each.
struct Track {
    std::vector<double> behind, bounds;
    double *anchors, *axial;
    std::uint8_t *sliding, *used;
    double tip, cut, reached;
};

/// Lets points stick and slip, and the tip cut on until it rests or needs more points; returns whether it breaks a membrane.
bool cut_on(const TrackPoints &points, const Enough &enough, Track &track);

}  // namespace sono

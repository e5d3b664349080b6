#include "contact/track.hpp"

#include <algorithm>
#include <cmath>

namespace sono {
namespace {

constexpr double kForward = 1e-9;  // mN, and the direction of friction where the tip has just come by
constexpr double kAll = 1 - 1e-9;  // of the most friction of a point: with that it slides, whatever rounding does
constexpr double kThere = 1e-9;    // mm that a tip is before a membrane which it is at

double dot(const std::vector<double> &a, const double *b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
}

void find_bounds(const TrackPoints &points, Track &track) {
    const std::size_t m = points.count;
    const double half = points.apart / 2, *const friction = points.resistance;
    for (std::size_t i = 0; i < m; ++i) {
        const double along = points.apart * static_cast<double>(i), begin = std::max(along - half, 0.0);
        const double in_cut = std::min(track.cut, along + track.anchors[i]);
        const double length = std::min(std::max(in_cut, begin), along + half) - begin;
        const double slow = friction[i] * (track.used[i] ? points.reuse : 1.0);
        const double slides = slow + friction[2 * m + i] * std::fabs(points.speed);
        track.bounds[i] = (track.sliding[i] ? slides : std::max(slow * friction[m + i], slides)) * length;
    }
}

void find_end(const TrackPoints &points, double cut, std::vector<double> &end) {
    for (std::size_t i = 0; i < end.size(); ++i)
        end[i] = std::max(0.0, 1.0 - std::fabs(points.apart * static_cast<double>(i) - cut) / points.apart);
}

/// Whether points that slide rub along all of the shaft that they stand for.
bool is_whole(const TrackPoints &points, double grown, const Track &track) {
    for (std::size_t i = 0; i < points.count; ++i) {
        const double bound = track.bounds[i], axial = track.axial[i];
        const bool rubs = track.sliding[i] || (bound > 0 && axial == 0);
        if (rubs && bound - std::fabs(axial) > grown * points.apart * points.resistance[i]) return false;
    }
    return true;
}

/// Forces of the pose, and what follows of them.
void balance(const TrackPoints &points, const Search &search, const std::vector<double> &end, double limit,
             Track &track) {
    for (std::size_t i = 0; i < points.count; ++i)
        if (track.bounds[i] > 0 && track.axial[i] == 0 && !track.sliding[i])
            track.sliding[i] = 1, track.axial[i] = kForward;
    find_bounds(points, track);
    const ShaftPoints shaft{points.compliance, end.data(),   points.bond, track.bounds.data(),
                            track.sliding,     points.count, limit};
    stick_slip(shaft, search, track.behind.data(), track.axial, track.anchors, track.tip);
    for (std::size_t i = 0; i < points.count; ++i) {
        const bool past = points.apart * static_cast<double>(i) < track.cut;
        if (track.anchors[i] < -points.apart / 2 && past) track.used[i] = 1;
        track.sliding[i] = std::fabs(track.axial[i]) >= kAll * track.bounds[i] && track.bounds[i] > 0;
    }
}

}  // namespace

bool cut_on(const TrackPoints &points, const Enough &enough, Track &track) {
    const std::size_t m = points.count;
    const double *const cutting = points.resistance + 3 * m;
    std::vector<double> end(m), before(m);
    track.bounds.resize(m);
    find_bounds(points, track);
    find_end(points, track.cut, end);
    bool breaks = false;
    for (int i = 0; i < enough.most; ++i) {
        const bool there = points.membrane <= track.cut + kThere;
        const double limit = std::max(there ? points.rupture : 0.0, dot(end, cutting));
        balance(points, enough.search, end, limit, track);
        const double ahead = -dot(end, track.behind.data());
        if (track.tip < limit || ahead > -enough.ends) {
            find_bounds(points, track);
            if (is_whole(points, enough.grown, track)) break;
            continue;
        }
        if ((breaks = there)) break;
        track.cut += std::min({-ahead, points.apart, points.membrane - track.cut});
        if (points.apart * static_cast<double>(m - 1) <= track.cut) break;
        before = end;
        find_end(points, track.cut, end);
        find_bounds(points, track);
        for (std::size_t j = 0; j < m; ++j) before[j] = track.tip * (end[j] - before[j]);
        for (std::size_t j = 0; j < m; ++j) track.behind[j] -= dot(before, points.compliance + j * m);
    }
    track.reached = track.cut + std::min(0.0, dot(end, track.behind.data()));
    return breaks;
}

}  // namespace sono

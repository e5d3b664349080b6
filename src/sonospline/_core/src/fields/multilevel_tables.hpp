// What interpolation of U = r from a coarse lattice misses near a landmark. On a lattice
// the error depends only on where the landmark lies relative to the coarse nodes (its
// parity class), so it is computed once per class and then added per landmark.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "fields/multilevel_kernels.hpp"

namespace sono {

/// Weights of polynomial interpolation midway between `order` (even) equidistant nodes.
std::vector<double> midpoint_stencil(int order);

/// Largest amplification of an error by interpolation along the three axes.
double amplification(int order);

/// One level: lattice of spacing 2^level, interpolated from one of twice the spacing.
struct LevelSpec {
    int level;
    int order;
    std::array<double, 3> ratio;  // spacing of each axis over that of x
    double cutoff;                // corrections below it are dropped; in spacings of level 0 along x
};

class LevelTables {
  public:
    LevelTables() = default;
    LevelTables(LevelTables &&) = default;  // not copied: views_ point into classes_

    /// The tables; empty where the errors do not fall below the cutoff within reach.
    static LevelTables build(const LevelSpec &spec);

    bool empty() const { return classes_.empty(); }
    /// Table of a landmark at a node of level 0.
    const CorrectionTable &of(int x, int y, int z) const {
        const int mask = period_ - 1;
        return views_[((x & mask) * period_ + (y & mask)) * period_ + (z & mask)];
    }
    /// Greatest offset of a correction from its landmark's node, whatever the axis.
    int reach() const { return reach_; }
    /// Runs of a landmark on average: what a correction costs.
    double runs_per_landmark() const;

  private:
    struct Class {
        int first_x;
        std::vector<std::uint32_t> starts;
        std::vector<Run> runs;
        std::vector<float> values;
    };
    static std::vector<Class> classes_within(const LevelSpec &spec, int period, int reach);
    static Class runs_of(const std::vector<double> &block, int reach, double cutoff);

    int period_ = 0, reach_ = 0;
    std::vector<Class> classes_;
    std::vector<CorrectionTable> views_;
};

}  // namespace sono

// u(x) = a0 + A x + sum_j w_j |x - c_j| on all nodes of a lattice, landmarks on nodes,
// at a cost that hardly depends on their number: direct sum on a lattice 2^depth times
// coarser, interpolation up, and a correction table per landmark and level.
//
// Error: every correction above `tolerance` is applied, so each level adds at most
// tolerance * sum |w|, amplified by the interpolations that follow.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <vector>

#include "fields/multilevel_refine.hpp"

namespace sono {

class MultilevelPlan {
  public:
    /// Throws std::invalid_argument where the spacing is too anisotropic for the tolerance. Threads may share one: each
    /// call has it alone.
    MultilevelPlan(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing, double tolerance,
                   const std::vector<int> &orders);

    const std::array<std::size_t, 3> &shape() const { return shape_; }
    int max_depth() const;
    /// Levels that are fastest for so many landmarks; 0 where the direct sum is.
    int depth(std::size_t landmarks);
    /// Bound of the error over sum |w|, rounding aside.
    double error_per_weight(int depth) const;
    /// out (nx, ny, nz, 3); index (n, 3); depth 0 is the fastest, at least 1.
    void evaluate(const std::int64_t *index, const double *weights, std::size_t count, const double *affine,
                  int depth, float *out);

  private:
    int levels() const { return static_cast<int>(orders_.size()); }
    double cost(int depth, std::size_t landmarks) const;
    int fastest_depth(std::size_t landmarks);
    void prepare(int depth);
    SortedLandmarks sort(const std::int64_t *index, const double *weights, std::size_t count) const;

    std::array<std::size_t, 3> shape_;
    std::array<double, 3> spacing_, ratio_;
    double tolerance_;
    std::vector<int> orders_;
    std::vector<Lattice> lattices_;             // one more than orders_
    std::vector<LevelTables> tables_;           // built when a depth first needs them
    std::vector<std::vector<float>> values_;    // of lattices 1 and up
    mutable std::mutex in_use_;
};

}  // namespace sono

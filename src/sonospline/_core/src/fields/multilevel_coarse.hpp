// The direct sum on the coarsest lattice of the multilevel sum.
#pragma once

#include "fields/multilevel_refine.hpp"

namespace sono {

class CoarseSum {
  public:
    /// Landmarks at nodes of level 0; lengths in units of its spacing along x.
    CoarseSum(const Lattice &lattice, int level, const std::array<double, 3> &ratio, const SortedLandmarks &landmarks,
              const std::array<float, 12> &affine);

    /// Floats from one plane to the next of the values.
    static std::size_t plane(const Lattice &lattice);
    std::size_t cut(int threads);
    void run(std::size_t block, float *out) const;

  private:
    Lattice lattice_;
    std::array<float, 12> affine_;
    std::vector<float> x_, y_, z_;                                // of planes, and of the nodes of a plane
    std::vector<float> landmark_x_, landmark_y_, landmark_z_, half_weights_;
    std::size_t groups_, pieces_ = 1;
};

}  // namespace sono

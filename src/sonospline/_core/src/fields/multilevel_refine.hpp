// One level of the multilevel sum: interpolate the coarser lattice, add what
// interpolation misses near the landmarks, write the finer lattice.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "fields/multilevel_tables.hpp"

namespace sono {

/// Nodes of one level, ghosts included: low[a] <= index < low[a] + count[a], spacing 2^level.
struct Lattice {
    std::array<int, 3> low, count;

    std::size_t nodes() const { return std::size_t(count[0]) * count[1] * count[2]; }
    std::size_t row() const { return 3 * std::size_t(count[2]); }
    int high(int axis) const { return low[axis] + count[axis] - 1; }
    /// The coarser lattice that interpolation of `order` onto this one reads.
    Lattice coarser(int order) const;
};

/// Values on a lattice, (x, y, z, 3) with contiguous rows.
template <class T> struct Values {
    T *data;
    std::size_t plane;  // floats from one x to the next
};

/// Landmarks sorted by x, at nodes of level 0; 4 weights each.
struct SortedLandmarks {
    std::vector<int> x, y, z;
    std::vector<float> weights;
    std::size_t count() const { return x.size(); }
};

class Refinement {
  public:
    Refinement(const Lattice &coarse, const Lattice &fine, int level, int order, const LevelTables &tables);

    /// Cuts the work into blocks that share nothing: slabs across y, parts along x.
    std::size_t cut(int threads);
    /// Fills one block of `out`; each thread works in scratch memory of its own.
    void run(std::size_t block, Values<const float> in, const SortedLandmarks &landmarks, Values<float> out) const;

  private:
    /// Pairs of an even and an odd plane, [first_pair, end_pair), and rows [y, y + rows).
    struct Part {
        int first_pair, end_pair, y, rows;
    };
    Part part(std::size_t block) const;
    std::vector<Placed> place(const Part &part, const SortedLandmarks &landmarks) const;
    void refine_plane(const Part &part, const float *plane, float *halo, float *out) const;
    void write(const Brick &brick, Values<float> out) const;

    Lattice coarse_, fine_;
    int level_, order_, reach_;
    const LevelTables &tables_;
    std::array<float, kMaxOrder> stencil_;
    int planes_;                   // coarse planes that a brick needs
    std::size_t row_;              // floats of an interpolated row
    std::size_t margin_, stride_;  // floats of a row being corrected before node low[2], and in all
    int bricks_;                   // of kPairs pairs of planes, along x
    int slabs_ = 1, parts_ = 1;
};

}  // namespace sono

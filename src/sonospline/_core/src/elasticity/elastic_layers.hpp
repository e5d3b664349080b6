// Cells whose layers make them stiffer along than across: what they resist beyond their isotropic
// moduli, to their mean strain.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "elasticity/elastic_layer_kernels.hpp"
#include "elasticity/elastic_level.hpp"

namespace sono {

/// Lowest corners (count, 3) of cells and the stiffness (count, 6, 6) that is added to each, of
/// strains xx, yy, zz, yz, xz, xy, the last three engineering ones. Any order.
struct ElasticLayersData {
    const std::int64_t *cells;
    const float *stiffness;
    std::size_t count;
};

class ElasticLayers {
  public:
    ElasticLayers(const ElasticLayersData &data, const ElasticLevel &level);

    bool any() const { return !places_.empty(); }
    /// Cells between two planes of nodes. Blocks of one parity share no node.
    std::size_t blocks(int parity) const { return (slots_.size() - static_cast<std::size_t>(parity)) / 2; }
    /// out += sign times the force of the cells of a block, for the displacement `in`; returns in . that force.
    double add(int parity, std::size_t block, const Fields &in, Fields &out, float sign) const;

  private:
    ElasticLayerCells cells_;
    std::vector<std::ptrdiff_t> places_;
    std::vector<float> stiffness_;
    std::vector<std::size_t> slots_;  // where the cells of each block begin, in groups of kElasticLanes
};

}  // namespace sono

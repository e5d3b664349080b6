// The hot loop of layered cells, compiled once per instruction set.
#pragma once

#include <cstddef>

#include "elasticity/elastic_kernels.hpp"

namespace sono {

/// How the nodes of layered cells lie, as in ElasticCells.
struct ElasticLayerCells {
    std::ptrdiff_t row, plane, component;
    float quarter[3];  // 1 / (4 side): the mean derivative along an axis is the sum of four differences times it
};

struct ElasticLayerKernels {
    /// out += sign times the force of `groups` times kElasticLanes layered cells; returns in . that force. `places`
    /// are of their lowest corners, `stiffness` 21 numbers each, upper triangle row by row, a vector for each number.
    double (*add)(const ElasticLayerCells &, const std::ptrdiff_t *places, const float *stiffness, std::size_t groups,
                  const float *in, float *out, float sign);
};

}  // namespace sono

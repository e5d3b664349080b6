// The hot loops of the elastic solver, compiled once per instruction set. Node and cell
// values lie plane after plane of constant x; in a plane, node (y, z) is number y nz + z.
// A plane is padded with zeros on either side, so that a loop over its numbers may run
// across the ends of rows: the cells that would join two rows have no stiffness.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sono {

constexpr int kElasticLanes = 16;  // planes are padded to it; every vector width divides it

/// What a sweep does with the force f = A in at each node, besides computing it.
enum class Sweep : int {
    product,   // out = f
    residual,  // out = b - f where the node is free, else 0
    smooth,    // d = momentum d + step D^-1 (b - f); out = in + d
};

/// Trilinear elements of one size, with their own moduli.
struct ElasticCells {
    std::size_t planes;      // of nodes
    std::ptrdiff_t row, plane;  // floats from one node to the next along y and x
    std::ptrdiff_t component;   // floats from one component to the next, and from lame to the shear modulus
    const float *lame;          // of each cell, times a 16th of its volume; 0 where there is none
    const float *springs;       // of each node, besides its cells; null where there are none
    float inverse[3];        // 1 / side
    bool full;               // full integration instead of the mean dilatation of each cell
};

/// The blocks of a node that are stored: to itself, and to the neighbours after it. Those to the others are transposes.
struct StencilOffset {
    int x, y, z;
};
constexpr int kStencilHalf = 14, kStencilInPlane = 5, kStencilFloats = 9 * kStencilHalf;
constexpr StencilOffset kStencilOffsets[kStencilHalf] = {
    {0, 0, 0},  {0, 0, 1},  {0, 1, -1}, {0, 1, 0},  {0, 1, 1},  {1, -1, -1}, {1, -1, 0},
    {1, -1, 1}, {1, 0, -1}, {1, 0, 0},  {1, 0, 1},  {1, 1, -1}, {1, 1, 0},   {1, 1, 1}};

/// An operator as blocks 3 a + b of each node. Those of a plane go by rows of neighbours, two and four times three; of a
/// row by kElasticLanes nodes; of those by number. A sweep goes straight through them.
struct ElasticStencil {
    std::size_t planes;         // of nodes
    std::ptrdiff_t row, plane;  // floats of a value from one node to the next along y and x
    std::ptrdiff_t component;   // floats from one component of a value to the next
    std::ptrdiff_t stride;      // nodes of a plane with zeros behind them, two at least: a multiple of kElasticLanes
    const float *blocks;        // kStencilFloats times as many for each plane
};

/// Where the blocks of node q of a plane begin, to `count` neighbours in one row, of which `first` is the first; each of
/// their numbers is kElasticLanes floats after the one before it.
constexpr std::ptrdiff_t stencil_place(std::ptrdiff_t first, std::ptrdiff_t count, std::ptrdiff_t q, std::ptrdiff_t stride) {
    const std::ptrdiff_t lane = q % kElasticLanes;
    return 9 * (first * stride + count * (q - lane)) + lane;
}

/// Nodes [first, last) of planes [begin, end), and what to do there.
struct ElasticSweep {
    std::size_t begin, end;
    std::ptrdiff_t first, last;
    const float *in, *b, *inverse_diagonal;  // the first of three components
    float *d, *out;
    float momentum, step;
    float *scratch;  // elastic_scratch(last - first, row) floats, or stencil_scratch(last, row) for an explicit operator
};

/// Floats of scratch a sweep of so many nodes a plane takes.
constexpr std::size_t elastic_scratch(std::ptrdiff_t nodes, std::ptrdiff_t row) {
    return static_cast<std::size_t>(3 * (nodes + row + 3 * kElasticLanes) + 6 * (row + 3 * kElasticLanes));
}

/// Of a sweep by an explicit operator: forces on two planes, with the zeros before and behind each component.
constexpr std::ptrdiff_t stencil_margin(std::ptrdiff_t row) {
    return (row + 3 * kElasticLanes) / kElasticLanes * kElasticLanes;
}
constexpr std::size_t stencil_scratch(std::ptrdiff_t nodes, std::ptrdiff_t row) {
    return static_cast<std::size_t>(6 * ((nodes + 3 * kElasticLanes) / kElasticLanes * kElasticLanes + 2 * stencil_margin(row)));
}

struct ElasticKernels {
    /// Returns the sum over the nodes of in . f (product), in . b (residual) or out . b (smooth).
    double (*sweep)(Sweep, const ElasticCells &, const ElasticSweep &);
    /// d = step D^-1 b; out = d: smoothing from zero. Ranges as in a sweep.
    void (*start)(const ElasticCells &, const ElasticSweep &);
};

struct StencilKernels {
    /// As a sweep through cells, of whole planes.
    void (*sweep)(Sweep, const ElasticStencil &, const ElasticSweep &);
};

}  // namespace sono

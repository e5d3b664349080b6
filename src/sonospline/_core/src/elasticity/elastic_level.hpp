// One grid of the elastic solver: its moduli, its vectors and the way to the next coarser one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/buffers.hpp"
#include "elasticity/elastic_kernels.hpp"

namespace sono {

/// Cells of one grid: moduli (cx, cy, cz), and what of it does not move.
struct ElasticLevelData {
    std::array<std::size_t, 3> cells;
    std::array<double, 3> spacing;
    const float *lame, *shear;
    std::array<bool, 6> pinned;   // faces x-, x+, y-, y+, z-, z+
    const std::uint8_t *fixed;    // nodes (nx, ny, nz) besides them; null where there are none
    bool full;                    // full integration instead of the mean dilatation of each cell
    const float *springs = nullptr;  // that hold nodes (3, nx, ny, nz); null where there are none
};

/// An explicit operator over the nodes of a grid (126, nx, ny, nz): the blocks of kStencilOffsets.
struct ElasticStencilData {
    std::array<std::size_t, 3> nodes;
    const float *blocks;
};

/// A displacement or force at the nodes of a level: three components, planes padded.
class Fields {
  public:
    Fields() = default;
    Fields(std::size_t planes, std::ptrdiff_t plane, std::ptrdiff_t front);
    float *operator[](int a) { return start_[a]; }
    const float *operator[](int a) const { return start_[a]; }
    std::size_t size() const { return size_; }  // floats of a component, padding within included

  private:
    Buffer<float> memory_;
    float *start_[3] = {};
    std::size_t size_ = 0;
};

/// Which coarse values (two neighbours) make up each fine one along an axis, and the transpose.
struct AxisTransfer {
    std::vector<std::size_t> coarse;  // the first of the two
    std::vector<float> weight;        // of the second
    std::vector<std::size_t> starts, fine;  // fine nodes that see each coarse one
    std::vector<float> share;               // and by how much
    AxisTransfer() = default;
    /// Coarse nodes are evenly spaced or, where they are `nested`, every second fine one and the last.
    AxisTransfer(std::size_t fine_cells, std::size_t coarse_cells, bool nested);
};

class ElasticLevel {
  public:
    explicit ElasticLevel(const ElasticLevelData &data);
    explicit ElasticLevel(const ElasticStencilData &data);

    const std::array<std::size_t, 3> &shape() const { return shape_; }
    const ElasticCells &cells() const { return cells_; }
    Fields make_fields() const { return Fields(shape_[0], cells_.plane, front_); }
    /// Whether a node moves.
    bool free(std::size_t i, std::size_t j, std::size_t k) const { return inverse_diagonal_[0][place(i, j, k)] > 0; }
    std::ptrdiff_t place(std::size_t i, std::size_t j, std::size_t k) const;

    /// Copies between (3, nx, ny, nz) and padded planes.
    void read(const float *from, Fields &to) const;
    void write(const Fields &from, float *to) const;

    /// Blocks of a sweep: one where the level is small.
    std::size_t blocks() const { return slabs_ * tiles_; }
    /// Whether a sweep may write what it reads.
    bool in_place() const { return blocks() == 1; }
    /// The part of a sweep that is block number `block`.
    double sweep(Sweep kind, std::size_t block, const Fields &in, const Fields *b, Fields *d, Fields &out,
                 float momentum, float step);
    void start(std::size_t block, const Fields &b, Fields &d, Fields &out, float step);
    /// Planes [first, last) of a block of whole planes, of `slabs()`.
    std::size_t slabs() const { return slabs_; }
    std::array<std::size_t, 2> slab(std::size_t number) const;
    /// Where the floats of such a block begin in each component, and how many they are.
    std::array<std::size_t, 2> floats(std::size_t slab) const;
    /// 1 / diagonal of A, 0 at nodes that do not move and in the padding.
    const Fields &inverse_diagonal() const { return inverse_diagonal_; }
    /// Sets the values at nodes that do not move to zero.
    void release_fixed(Fields &values) const;

    /// Chebyshev steps on [1/20, 1.1] times the largest eigenvalue of D^-1 A: momentum and step of each.
    void find_smoothing(int degree);
    const std::vector<std::array<float, 2>> &smoothing() const { return smoothing_; }

    void join(const ElasticLevel &coarser);
    /// Planes [begin, end) of coarse.b = P^T of this level's fields.
    void restrict_to(ElasticLevel &coarser, const Fields &from, std::size_t begin, std::size_t end);
    /// Rows of this level's correction, interpolated along z only, of coarse planes [begin, end).
    void widen(const ElasticLevel &coarser, std::size_t begin, std::size_t end);
    /// x += P coarse.x in planes [begin, end), once all planes are widened.
    void correct(const ElasticLevel &coarser, std::size_t begin, std::size_t end);

    Fields b, x, other, d, residual;  // `other`: where sweeps that cannot work in place write

  private:
    void lay_out(std::size_t most_alone);
    void take_moduli(const ElasticLevelData &data);
    void find_diagonal(const ElasticLevelData &data);
    void take_blocks(const ElasticStencilData &data);
    double largest_eigenvalue();

    std::array<std::size_t, 3> shape_;
    std::ptrdiff_t front_;
    ElasticCells cells_{};
    ElasticStencil stencil_{};  // in the place of the cells, where it has blocks
    bool some_fixed_ = false;   // nodes within the grid
    Buffer<float> memory_;      // of the moduli or blocks
    Fields springs_;
    Fields inverse_diagonal_;
    std::size_t slabs_, tiles_;
    std::size_t scratch_size_;
    Buffer<float> scratch_;
    std::vector<std::array<float, 2>> smoothing_;
    std::array<AxisTransfer, 3> transfer_;
    Buffer<float> widened_;  // (3, coarse nx, coarse ny, nz)
};

}  // namespace sono

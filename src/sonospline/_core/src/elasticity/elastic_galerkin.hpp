// Coarse operators P^T A P, with P the linear interpolation from every second node and zero where nodes do not move:
// what a coarse grid knows of bone, which the means of moduli do not.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace sono {

/// Cells of a grid with their moduli, and what a cell of unit moduli is like: 24 x 24 over (component, corner).
struct GalerkinCells {
    std::array<std::size_t, 3> cells;
    const float *lame, *shear;
    const double *dilatation, *distortion;
    const std::uint8_t *fixed;  // (nx, ny, nz): nodes that do not move
};

/// The operator of cells over coarse nodes, of which each axis has as many or every second: (126, nx, ny, nz), the
/// blocks of kStencilOffsets. Coarse nodes that do not move have none.
void galerkin_of_cells(const GalerkinCells &fine, const std::array<std::size_t, 3> &coarse, float *out);

/// The same of an operator (126, nx, ny, nz) over the nodes of a grid.
void galerkin_of_stencil(const float *fine, const std::array<std::size_t, 3> &nodes,
                         const std::array<std::size_t, 3> &coarse, float *out);

}  // namespace sono

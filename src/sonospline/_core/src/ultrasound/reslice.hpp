// A plane through a deformed image: each pixel shows the voxel that the inverse map brings there.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "ultrasound/reslice_kernels.hpp"
#include "fields/sampling.hpp"

namespace sono {

struct PixelPlane {
    double pixel[9];   // columns: step along a row, step along a column, pixel (0, 0); lattice mm
    double index[12];  // rows of (3, 4): lattice mm -> voxel index
    std::size_t rows, columns;
};

/// grey and seen (rows, columns): linear between voxels; 0 where the inverse is not found within
/// `tolerance` mm in `most` iterations, outside the image, or at a voxel not seen. Between every fourth pixel
/// the inverse is linear, where that meets it in the middle within `tolerance`.
void reslice(const LatticeField &, const VoxelImage &, const PixelPlane &, double tolerance, int most, float *grey,
             std::uint8_t *seen);

}  // namespace sono

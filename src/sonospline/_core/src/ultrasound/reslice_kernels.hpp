// The hot loop of reslicing, compiled once per instruction set: many places of an image at once.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace sono {

struct VoxelImage {
    const float *grey;
    const std::uint8_t *seen;  // 0 where there is no image; null: all of it is
    std::array<std::size_t, 3> shape;
};

struct ResliceKernels {
    /// grey and seen at voxel indices (3 rows of n): linear between voxels; 0 beyond half a voxel around the
    /// image and where the nearest voxel is not seen
    void (*sample)(const VoxelImage &, const float *const index[3], std::size_t n, float *grey, std::uint8_t *seen);
};

}  // namespace sono

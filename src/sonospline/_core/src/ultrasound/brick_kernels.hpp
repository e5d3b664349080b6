// The hot loops of the choice of scatterers, compiled once per instruction set: a brick's
// scatterers at once, as separate arrays, and the impedance around interfaces.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sono {

constexpr std::size_t kMostInBrick = 512;
constexpr double kFarCell = 1e6;  // further from the first cell than a lattice may reach

/// What a place in image coordinates means to a probe.
struct BeamScope {
    bool curved;
    double apex, depth, cos, sin, half_width, beside;  // cos, sin of half the sector
    double variance, spread_squared, focus, cut_squared;
    double cell_mm2, f_number, aperture;
    double slack;  // displacement allowed for
};

/// A brick and the pattern that fills it, mirrored where `sign` is -1.
struct Brick {
    double index[3], side;
    const float *places[3];
    float flip[3], sign[3];
    std::size_t count;
};

/// A label map's size, and where positions (scene lattice mm) lie in a displacement lattice.
struct Lattices {
    double voxels_per_mm[3], shape[3];
    double to_cell[12];
};

struct BrickKernels {
    /// Positions (scene lattice mm), range, and whether a displaced echo may reach a beam
    void (*place)(const BeamScope &, const double to_image[12], const Brick &, double (*local)[kMostInBrick],
                  double *range, std::uint8_t *heard);
    /// For scatterers number[i] of a brick of hash `key`: voxel (-1 outside), 1 / sqrt(density), cell, place in it
    void (*assign)(const BeamScope &, const Lattices &, std::uint64_t key, const std::int32_t *number, std::size_t count,
                   const double (*local)[kMostInBrick], const double *range, std::int64_t *voxel, double *weight,
                   std::int32_t (*cell)[kMostInBrick], std::int32_t (*place)[kMostInBrick]);
    /// Weighted sums to[k] of from[k - radius * apart] to from[k + radius * apart], weights[0] for the middle
    void (*smooth)(const float *from, std::ptrdiff_t apart, const double *weights, std::ptrdiff_t radius,
                   std::ptrdiff_t count, float *to);
};

}  // namespace sono

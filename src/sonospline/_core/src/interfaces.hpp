// Surfaces of a label map where the acoustic impedance steps, as points.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace sono {

struct LabelMap {
    const std::uint8_t *labels;
    std::array<std::size_t, 3> shape;
    std::array<double, 3> spacing;
};

/// Place (lattice mm), unit normal, reflection coefficient, and the surface it stands for (mm^2).
struct InterfacePoint {
    float place[3], normal[3], reflection, area;
};

/// Points on each face between voxels, all axes alike, and the largest face (mm^2).
std::size_t interface_copies(const LabelMap &, double points_per_mm2);
double largest_face(const LabelMap &);

/// Points of one block of voxels: the first of every face, then the second of every face...
struct InterfaceBlock {
    std::array<double, 3> centre;  // lattice mm
    double radius;
    std::vector<InterfacePoint> points;
};

/// The blocks that hold points. `smoothing` is the standard deviation in voxels of the finest axis.
std::vector<InterfaceBlock> find_interfaces(const LabelMap &, const double impedance[256], double smoothing,
                                            double smallest, double largest, double points_per_mm2);

}  // namespace sono

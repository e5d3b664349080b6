// Surfaces of a label map where the acoustic impedance steps, as points.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

namespace sono {

struct LabelMap {
    const std::uint8_t *labels;
    std::array<std::size_t, 3> shape;
    std::array<double, 3> spacing;
};

/// Place (lattice mm), unit normal towards the higher impedance, reflection coefficient, the surface it stands for
/// (mm^2), the labels it parts, and a random sign.
struct InterfacePoint {
    float place[3], normal[3], reflection, area;
    std::uint8_t low, high;
    std::int8_t sign;
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

/// Interfaces of a label map, found block by block as they are asked for: a probe hears a slice of a scene.
class Interfaces {
  public:
    /// `smoothing` is the standard deviation in voxels of the finest axis.
    Interfaces(const LabelMap &, const double impedance[256], double smoothing, double smallest, double largest,
               double points_per_mm2);
    ~Interfaces();

    std::size_t regions() const { return found_.size(); }
    /// Middle and half the sides of a box that holds every point of a region.
    std::array<double, 3> centre(std::size_t region) const;
    const std::array<double, 3> &half() const { return half_; }
    /// The blocks of some regions that hold points, in order; from any thread.
    std::vector<const InterfaceBlock *> blocks(const std::vector<std::size_t> &regions);

  private:
    class Finder;
    const std::unique_ptr<const Finder> finder_;
    const std::array<double, 3> half_;
    std::mutex mutex_;  // held while regions are found
    std::vector<std::vector<InterfaceBlock>> found_;
    std::vector<char> known_;
};

}  // namespace sono

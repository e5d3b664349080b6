#include "ultrasound/interfaces.hpp"

#include <algorithm>
#include <cmath>

#include "ultrasound/brick_kernels.hpp"
#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "common/require.hpp"

namespace sono {
namespace {

constexpr int kSide = 32;       // voxels of a region: smoothed together
constexpr int kBlockSide = 16;  // of a block of points
constexpr double kMostCopies = 1e9;
using Index = std::array<std::ptrdiff_t, 3>;

// Weights at 0, 1, ... of a Gaussian cut off at four standard deviations.
std::vector<double> gaussian(double sigma) {
    const int radius = static_cast<int>(4 * sigma + 0.5);
    std::vector<double> weights(radius + 1);
    double sum = 0;
    for (int k = 0; k <= radius; ++k) sum += (k ? 2 : 1) * (weights[k] = std::exp(-0.5 * k * k / (sigma * sigma)));
    for (double &w : weights) w /= sum;
    return weights;
}

std::ptrdiff_t reflected(std::ptrdiff_t i, std::ptrdiff_t n) {
    while (i < 0 || i >= n) i = i < 0 ? -1 - i : 2 * n - 1 - i;
    return i;
}

// Half the sides of a box around so many voxels, and their points, which shift.
std::array<double, 3> half_of(const LabelMap &map, int side) {
    std::array<double, 3> half;
    for (int a = 0; a < 3; ++a) half[a] = (0.5 * side + 2) * map.spacing[a];
    return half;
}

}  // namespace

class Interfaces::Finder {
  public:
    Finder(const LabelMap &map, const double *impedance, double smoothing, double smallest, double largest,
           double points_per_mm2)
        : map_(map), impedance_(impedance), largest_(largest),
          copies_(interface_copies(map, points_per_mm2)),
          finest_(*std::min_element(map.spacing.begin(), map.spacing.end())) {
        const double voxel = map.spacing[0] * map.spacing[1] * map.spacing[2];
        for (int a = 0; a < 3; ++a) {
            shape_[a] = static_cast<std::ptrdiff_t>(map.shape[a]);
            weights_[a] = gaussian(smoothing * finest_ / map.spacing[a]);
            face_[a] = voxel / map.spacing[a];
        }
        stride_ = {shape_[1] * shape_[2], shape_[2], 1};
        for (int a = 0; a < 3; ++a) regions_[a] = (shape_[a] + kSide - 1) / kSide;
        for (int x = 0; x < 256; ++x)
            for (int y = 0; y < 256; ++y)
                seen_[x][y] = std::fabs(impedance[x] - impedance[y]) / (impedance[x] + impedance[y]) > smallest;
    }

    std::size_t regions() const { return static_cast<std::size_t>(regions_[0] * regions_[1] * regions_[2]); }

    std::array<double, 3> centre(std::size_t region) const {
        const Index first = first_of(region);
        std::array<double, 3> out;
        for (int a = 0; a < 3; ++a) out[a] = (static_cast<double>(first[a]) + 0.5 * kSide) * map_.spacing[a];
        return out;
    }

    std::vector<InterfaceBlock> operator()(std::size_t region) const {
        const Index first = first_of(region);
        Index last;
        for (int a = 0; a < 3; ++a) last[a] = std::min(first[a] + kSide, shape_[a]);
        const std::vector<Face> faces = find(first, last);
        if (faces.empty()) return {};
        const Smooth smooth = smoothed(first, last);
        constexpr int each = kSide / kBlockSide;
        std::vector<InterfaceBlock> blocks(each * each * each);
        for (int a = 0; a < 3; ++a)
            for (std::ptrdiff_t b = 0; b < each * each * each; ++b) {
                const std::ptrdiff_t of_axis = a == 0 ? b / (each * each) : a == 1 ? b / each % each : b % each;
                blocks[b].centre[a] = (static_cast<double>(first[a] + of_axis * kBlockSide) + 0.5 * kBlockSide) * map_.spacing[a];
            }
        std::array<std::size_t, each * each * each> counts{}, next{};
        const auto block_of = [&](const Face &face) {
            std::ptrdiff_t b = 0;
            for (int a = 0; a < 3; ++a) b = b * each + (face.at[a] - first[a]) / kBlockSide;
            return static_cast<std::size_t>(b);
        };
        for (const Face &face : faces) ++counts[block_of(face)];
        for (std::size_t b = 0; b < blocks.size(); ++b) blocks[b].points.resize(counts[b] * copies_);
        for (const Face &face : faces) {
            const std::size_t b = block_of(face);
            place(face, smooth, blocks[b].points.data() + next[b]++, counts[b]);
        }
        const std::array<double, 3> half = half_of(map_, kBlockSide);
        const double radius = std::sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
        for (InterfaceBlock &block : blocks) block.radius = radius;
        blocks.erase(std::remove_if(blocks.begin(), blocks.end(), [](const auto &block) { return block.points.empty(); }),
                     blocks.end());
        return blocks;
    }

  private:
    struct Face {
        Index at;  // the voxel before it
        int axis;
        std::uint8_t low, high;
    };
    struct Smooth {
        Index first, size;
        const std::vector<float> &values;
        float operator()(const Index &at) const {
            return values[static_cast<std::size_t>(((at[0] - first[0]) * size[1] + at[1] - first[1]) * size[2] + at[2] -
                                                   first[2])];
        }
    };

    Index first_of(std::size_t region) const {
        const auto n = static_cast<std::ptrdiff_t>(region);
        return {n / (regions_[1] * regions_[2]) * kSide, n / regions_[2] % regions_[1] * kSide, n % regions_[2] * kSide};
    }

    std::vector<Face> find(const Index &first, const Index &last) const {
        std::vector<Face> faces;
        for (std::ptrdiff_t i = first[0]; i < last[0]; ++i)
            for (std::ptrdiff_t j = first[1]; j < last[1]; ++j) {
                const std::uint8_t *row = map_.labels + i * stride_[0] + j * stride_[1];
                for (int axis = 0; axis < 3; ++axis) {
                    if ((axis == 0 && i + 1 >= shape_[0]) || (axis == 1 && j + 1 >= shape_[1])) continue;
                    const std::uint8_t *beside = row + stride_[axis];
                    const std::ptrdiff_t end = axis == 2 ? std::min(last[2], shape_[2] - 1) : last[2];
                    if (std::equal(row + first[2], row + end, beside + first[2])) continue;
                    for (std::ptrdiff_t k = first[2]; k < end; ++k)
                        if (seen_[row[k]][beside[k]])
                            faces.push_back({{i, j, k}, axis, row[k], beside[k]});
                }
            }
        return faces;
    }

    // The impedance around a block, smoothed along one axis after the other, rounded to float after each.
    Smooth smoothed(const Index &first, const Index &last) const {
        Index begin, size;
        for (int a = 0; a < 3; ++a) {
            const auto radius = static_cast<std::ptrdiff_t>(weights_[a].size()) - 1;
            begin[a] = first[a] - 1 - radius, size[a] = last[a] + 2 + radius - begin[a];
        }
        const BrickKernels &kernel = *kernels().brick;
        thread_local std::vector<float> in, out;  // fresh pages would cost as much as the sums
        in.resize(static_cast<std::size_t>(size[0] * size[1] * size[2]));
        std::size_t n = 0;
        for (std::ptrdiff_t i = 0; i < size[0]; ++i)
            for (std::ptrdiff_t j = 0; j < size[1]; ++j) {
                const std::uint8_t *row = map_.labels + reflected(begin[0] + i, shape_[0]) * stride_[0] +
                                          reflected(begin[1] + j, shape_[1]) * stride_[1];
                for (std::ptrdiff_t k = 0; k < size[2]; ++k)
                    in[n++] = static_cast<float>(impedance_[row[reflected(begin[2] + k, shape_[2])]]);
            }
        for (int axis = 0; axis < 3; ++axis) {
            const std::vector<double> &w = weights_[axis];
            const auto radius = static_cast<std::ptrdiff_t>(w.size()) - 1;
            Index wanted = size;
            wanted[axis] -= 2 * radius;
            const std::ptrdiff_t inner = axis == 0 ? size[1] * size[2] : axis == 1 ? size[2] : 1;
            const std::ptrdiff_t outer = axis == 0 ? 1 : axis == 1 ? size[0] : size[0] * size[1];
            out.resize(static_cast<std::size_t>(wanted[0] * wanted[1] * wanted[2]));
            const std::ptrdiff_t run = inner * wanted[axis];
            for (std::ptrdiff_t o = 0; o < outer; ++o)
                kernel.smooth(in.data() + o * inner * size[axis] + radius * inner, inner, w.data(), radius, run,
                              out.data() + o * run);
            in.swap(out);
            begin[axis] += radius, size = wanted;
        }
        return {begin, size, in};
    }

    // Points off the face's middle by a hash of their place, moved along the normal onto the smoothed step;
    // `apart` in memory.
    void place(const Face &face, const Smooth &smooth, InterfacePoint *points, std::size_t apart) const {
        const int axis = face.axis;
        Index beside = face.at;
        ++beside[axis];
        const double before = smooth(face.at), after = smooth(beside);
        double normal[3], squared = 0;
        for (int a = 0; a < 3; ++a) {
            if (a == axis) {
                normal[a] = (after - before) / map_.spacing[a];
            } else {
                double total = 0;
                for (const Index &side : {face.at, beside}) {
                    Index ahead = side, behind = side;
                    ahead[a] = std::min(ahead[a] + 1, shape_[a] - 1), behind[a] = std::max<std::ptrdiff_t>(behind[a] - 1, 0);
                    total += static_cast<double>(smooth(ahead)) - static_cast<double>(smooth(behind));
                }
                normal[a] = total / (4 * map_.spacing[a]);
            }
            squared += normal[a] * normal[a];
        }
        const double slope = std::sqrt(squared) + 1e-12;
        for (double &n : normal) n /= slope;
        const double z1 = impedance_[face.low], z2 = impedance_[face.high];
        const double shift = std::clamp(((z1 + z2) / 2 - (before + after) / 2) / slope, -finest_, finest_);
        const std::uint64_t voxel = (static_cast<std::uint64_t>(face.at[0]) << 28) +
                                    (static_cast<std::uint64_t>(face.at[1]) << 14) + static_cast<std::uint64_t>(face.at[2]);
        for (std::size_t copy = 0; copy < copies_; ++copy) {
            std::uint64_t key = (voxel * 3 + static_cast<std::uint64_t>(axis)) * 64 + copy;
            key *= 0x9E3779B97F4A7C15u;
            key = (key ^ (key >> 29)) * 0xBF58476D1CE4E5B9u;
            double tangent[3], along = 0;
            for (int a = 0; a < 3; ++a) {
                tangent[a] = a == axis ? 0 : (static_cast<double>(key >> (8 + 16 * a) & 0xFFFF) / 65536 - 0.5) * map_.spacing[a];
                along += tangent[a] * normal[a];
            }
            InterfacePoint &point = points[copy * apart];
            for (int a = 0; a < 3; ++a) {
                const double middle = (static_cast<double>(face.at[a]) + (a == axis ? 0.5 : 0.0)) * map_.spacing[a];
                point.place[a] = static_cast<float>(middle + (shift - along) * normal[a] + tangent[a]);
                point.normal[a] = static_cast<float>(normal[a]);
            }
            point.reflection = static_cast<float>(std::min(std::fabs(z2 - z1) / (z2 + z1), largest_));
            point.area = static_cast<float>(face_[axis] / static_cast<double>(copies_) * std::fabs(normal[axis]));
            point.low = face.low, point.high = face.high;
            point.sign = key >> 63 ? 1 : -1;
        }
    }

    const LabelMap map_;
    const double *impedance_;
    const double largest_;
    const std::size_t copies_;
    const double finest_;
    Index shape_, stride_, regions_;
    std::array<std::vector<double>, 3> weights_;
    std::array<double, 3> face_;
    bool seen_[256][256];  // whether two labels make a surface
};

double largest_face(const LabelMap &map) {
    const std::array<double, 3> &h = map.spacing;
    return std::max({h[0] * h[1], h[1] * h[2], h[0] * h[2]});
}

std::size_t interface_copies(const LabelMap &map, double points_per_mm2) {
    return whole_within<std::size_t>(std::nearbyint(points_per_mm2 * largest_face(map)), 1.0, kMostCopies);
}

Interfaces::Interfaces(const LabelMap &map, const double impedance[256], double smoothing, double smallest, double largest,
                       double points_per_mm2)
    : finder_(std::make_unique<Finder>(map, impedance, smoothing, smallest, largest, points_per_mm2)),
      half_(half_of(map, kSide)), found_(finder_->regions()), known_(finder_->regions()) {}

Interfaces::~Interfaces() = default;

std::array<double, 3> Interfaces::centre(std::size_t region) const { return finder_->centre(region); }

std::vector<const InterfaceBlock *> Interfaces::blocks(const std::vector<std::size_t> &regions) {
    {
        std::lock_guard<std::mutex> lock(mutex_);
        std::vector<std::size_t> unknown;
        for (const std::size_t region : regions)
            if (!known_[region]) unknown.push_back(region);
        parallel_for(unknown.size(), [&](std::size_t i) { found_[unknown[i]] = (*finder_)(unknown[i]); });
        for (const std::size_t region : unknown) known_[region] = 1;
    }
    std::vector<const InterfaceBlock *> blocks;
    for (const std::size_t region : regions)
        for (const InterfaceBlock &block : found_[region]) blocks.push_back(&block);
    return blocks;
}

}  // namespace sono

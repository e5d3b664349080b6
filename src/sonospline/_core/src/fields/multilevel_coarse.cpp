#include "fields/multilevel_coarse.hpp"

#include <algorithm>

#include "common/kernels.hpp"

namespace sono {
namespace {

std::size_t padded_nodes(const Lattice &lattice) {
    const std::size_t nodes = std::size_t(lattice.count[1]) * lattice.count[2];
    return (nodes + kLanePad - 1) / kLanePad * kLanePad;
}

std::vector<float> scaled(const std::vector<int> &index, double by) {
    std::vector<float> result(index.size());
    std::transform(index.begin(), index.end(), result.begin(), [by](int i) { return static_cast<float>(i * by); });
    return result;
}

}  // namespace

std::size_t CoarseSum::plane(const Lattice &lattice) { return 3 * padded_nodes(lattice); }

CoarseSum::CoarseSum(const Lattice &lattice, int level, const std::array<double, 3> &ratio,
                     const SortedLandmarks &landmarks, const std::array<float, 12> &affine)
    : lattice_(lattice), affine_(affine), landmark_x_(scaled(landmarks.x, ratio[0])),
      landmark_y_(scaled(landmarks.y, ratio[1])), landmark_z_(scaled(landmarks.z, ratio[2])),
      half_weights_(landmarks.weights.size()), groups_((lattice.count[0] + kMaxPlanes - 1) / kMaxPlanes) {
    std::transform(landmarks.weights.begin(), landmarks.weights.end(), half_weights_.begin(),
                   [](float w) { return 0.5f * w; });
    const double step = 1 << level;
    for (int i = 0; i < lattice.count[0]; ++i) x_.push_back(float((lattice.low[0] + i) * step * ratio[0]));
    // Lanes past the last node are computed and never read.
    for (std::size_t node = 0; node < padded_nodes(lattice); ++node) {
        y_.push_back(float((lattice.low[1] + int(node) / lattice.count[2]) * step * ratio[1]));
        z_.push_back(float((lattice.low[2] + int(node) % lattice.count[2]) * step * ratio[2]));
    }
}

std::size_t CoarseSum::cut(int threads) {
    const std::size_t vectors = y_.size() / kLanePad;
    pieces_ = std::clamp<std::size_t>((8 * threads + groups_ - 1) / groups_, 1, vectors);
    return groups_ * pieces_;
}

void CoarseSum::run(std::size_t block, float *out) const {
    const std::size_t group = block / pieces_, piece = block % pieces_;
    const std::size_t vectors = y_.size() / kLanePad, stride = plane(lattice_);
    const std::size_t begin = x_.size() * group / groups_, end = x_.size() * (group + 1) / groups_;
    thread_local std::vector<float> scratch;
    scratch.resize(std::max(scratch.size(), kMaxPlanes * landmark_x_.size()));

    CoarsePlanes planes;
    planes.planes = static_cast<int>(end - begin);
    for (std::size_t i = begin; i < end; ++i) {
        planes.x[i - begin] = x_[i];
        planes.out[i - begin] = out + i * stride;
    }
    planes.y = y_.data();
    planes.z = z_.data();
    planes.first = vectors * piece / pieces_ * kLanePad;
    planes.last = vectors * (piece + 1) / pieces_ * kLanePad;
    planes.affine = affine_.data();
    planes.scratch = scratch.data();
    kernels().multilevel->coarse_sum({landmark_x_.data(), landmark_y_.data(), landmark_z_.data(),
                                      half_weights_.data(), landmark_x_.size()},
                                     planes);
}

}  // namespace sono

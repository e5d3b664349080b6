#include "fields/multilevel_refine.hpp"

#include <algorithm>

#include "common/kernels.hpp"

namespace sono {
namespace {

// Scratch of a block, which should stay in a core's own cache: the planes being
// interpolated, and the planes being corrected.
constexpr std::size_t kScratchFloats = 200'000;
constexpr int kFewestRows = 8, kBlocksPerThread = 2;
// Results larger than this leave the caches before anyone reads them.
constexpr std::size_t kStreamedBytes = std::size_t(24) << 20;

constexpr std::size_t kAligned = 16;  // floats in a cache line
std::size_t aligned(std::size_t floats) { return (floats + kAligned - 1) / kAligned * kAligned; }

int floor_half(int i) { return i >> 1; }  // also below zero

// Grow-only memory of the calling thread, on a cache line.
float *scratch(std::size_t floats) {
    thread_local std::vector<float> memory;
    if (memory.size() < floats + kAligned) memory.assign(floats + kAligned, 0.0f);
    const auto address = reinterpret_cast<std::uintptr_t>(memory.data());
    return memory.data() + (64 - address % 64) % 64 / sizeof(float);
}

}  // namespace

Lattice Lattice::coarser(int order) const {
    Lattice result;
    for (int a = 0; a < 3; ++a) {
        result.low[a] = floor_half(low[a]) - (order / 2 - 1);
        result.count[a] = floor_half(high(a) - 1) + order / 2 - result.low[a] + 1;
    }
    return result;
}

Refinement::Refinement(const Lattice &coarse, const Lattice &fine, int level, int order, const LevelTables &tables)
    : coarse_(coarse), fine_(fine), level_(level), order_(order), reach_(tables.reach() + 1), tables_(tables),
      stencil_{}, planes_(kPairs + order - 1), row_(aligned(fine.row() + 3)),
      margin_(aligned(3 * std::size_t(reach_ + 1))),
      stride_(margin_ + aligned(fine.row() + 3 * std::size_t(reach_ + kRun))),
      bricks_((floor_half(fine.high(0)) - floor_half(fine.low[0]) + kPairs) / kPairs) {
    const std::vector<double> stencil = midpoint_stencil(order);
    std::copy(stencil.begin(), stencil.end(), stencil_.begin());
}

std::size_t Refinement::cut(int threads) {
    // A core that is busy elsewhere then delays the rest by part of its share only.
    const int blocks = threads == 1 ? 1 : kBlocksPerThread * threads;
    const int fitting = std::max(kFewestRows, int(kScratchFloats / (2 * kPairs * stride_ + planes_ * row_)));
    const int wanted = (blocks + bricks_ - 1) / bricks_;  // where there are too few bricks to share
    slabs_ = std::max({(fine_.count[1] + fitting - 1) / fitting, std::min(wanted, fine_.count[1] / kFewestRows), 1});
    // Each part repeats order - 1 coarse planes of its neighbour: no more parts than needed.
    parts_ = std::clamp((blocks + slabs_ - 1) / slabs_, 1, bricks_);
    return std::size_t(slabs_) * parts_;
}

Refinement::Part Refinement::part(std::size_t block) const {
    const int x = static_cast<int>(block) / slabs_, y = static_cast<int>(block) % slabs_;
    const int first = floor_half(fine_.low[0]), end = floor_half(fine_.high(0)) + 1;
    Part part;
    part.first_pair = first + kPairs * (bricks_ * x / parts_);
    part.end_pair = std::min(first + kPairs * (bricks_ * (x + 1) / parts_), end);
    part.y = fine_.low[1] + fine_.count[1] * y / slabs_;
    part.rows = fine_.low[1] + fine_.count[1] * (y + 1) / slabs_ - part.y;
    return part;
}

// The landmarks whose corrections reach a part, in the order given.
std::vector<Placed> Refinement::place(const Part &part, const SortedLandmarks &landmarks) const {
    std::vector<Placed> placed;
    const auto even_node = [&](int i) { return 2 * (i >> (level_ + 1)); };
    const auto touches = [&](int node, int first, int end) { return node + reach_ >= first && node - reach_ < end; };
    for (std::size_t j = 0; j < landmarks.count(); ++j) {
        const int x = landmarks.x[j], y = landmarks.y[j], z = landmarks.z[j];
        if (touches(even_node(x), 2 * part.first_pair, 2 * part.end_pair) &&
            touches(even_node(y), part.y, part.y + part.rows))
            placed.push_back({even_node(x), even_node(y), even_node(z) - fine_.low[2], &tables_.of(x, y, z),
                              &landmarks.weights[4 * j]});
    }
    return placed;
}

// One coarse plane, refined along z, then y: the rows of `part` go to `out`, coarse rows
// beyond them to `halo`.
void Refinement::refine_plane(const Part &part, const float *plane, float *halo, float *out) const {
    const MultilevelKernels &kernel = *kernels().multilevel;
    const int half = order_ / 2, end = part.y + part.rows;
    const int first = floor_half(part.y) - (half - 1);
    const int last = std::min(floor_half(end - 2) + half, coarse_.high(1));
    const int pairs = floor_half(fine_.high(2)) - floor_half(fine_.low[2]) + 1;
    // An even row of the part is a coarse row: it is refined in place.
    const auto refined = [&](int k) {
        if (2 * k >= part.y && 2 * k < end) return out + (2 * k - part.y) * row_;
        return halo + (2 * k < part.y ? k - first : k - floor_half(end - 1) - 1 + half) * row_;
    };
    for (int k = first; k <= last; ++k)
        kernel.refine_row(order_, stencil_.data(), plane + (k - coarse_.low[1]) * coarse_.row(), pairs, refined(k));
    for (int y = part.y | 1; y < end; y += 2) {
        const float *in[kMaxOrder];
        for (int m = 0; m < order_; ++m) in[m] = refined(floor_half(y) - (half - 1) + m);
        kernel.combine(order_, stencil_.data(), in, fine_.row() + 3, out + (y - part.y) * row_);
    }
}

void Refinement::write(const Brick &brick, Values<float> out) const {
    const bool past_caches = fine_.nodes() * 3 * sizeof(float) > kStreamedBytes;
    const int first = std::max(brick.x, fine_.low[0]), end = std::min(brick.x + brick.planes, fine_.high(0) + 1);
    for (int x = first; x < end; ++x)
        kernels().multilevel->copy(
            {brick.data + (x - brick.x) * brick.plane, brick.row},
            {out.data + (x - fine_.low[0]) * out.plane + (brick.y - fine_.low[1]) * fine_.row(), fine_.row()},
            brick.rows, fine_.row(), past_caches);
}

void Refinement::run(std::size_t block, Values<const float> in, const SortedLandmarks &landmarks,
                     Values<float> out) const {
    const MultilevelKernels &kernel = *kernels().multilevel;
    const Part part = this->part(block);
    const std::size_t ring_plane = part.rows * row_ + kRowSlack, brick_plane = part.rows * stride_;
    const std::size_t halo_floats = order_ * row_ + kRowSlack;
    float *const ring = scratch(planes_ * ring_plane + halo_floats + 2 * kPairs * brick_plane + kRowSlack);
    float *const halo = ring + planes_ * ring_plane, *const corrected = halo + halo_floats;
    const auto in_ring = [&](int k) { return ring + (k - coarse_.low[0]) % planes_ * ring_plane; };

    const std::vector<Placed> placed = place(part, landmarks);
    const Placed *begin = placed.data(), *end = begin, *const all = begin + placed.size();
    int known = part.first_pair - (order_ / 2 - 1);  // the first coarse plane not yet refined
    for (int pair = part.first_pair; pair < part.end_pair; pair += kPairs) {
        const int first = pair - (order_ / 2 - 1), last = std::min(pair + kPairs - 1 + order_ / 2, coarse_.high(0));
        for (; known <= last; ++known)
            refine_plane(part, in.data + (known - coarse_.low[0]) * in.plane, halo, in_ring(known));
        // The last brick of a part may be short: its spare planes come from whatever is there.
        Rows<const float> from[kMaxOrder + kPairs];
        for (int m = 0; m < planes_; ++m) from[m] = {in_ring(first + m) + 3 * (fine_.low[2] & 1), row_};
        Brick brick = {2 * pair, 2 * std::min(kPairs, part.end_pair - pair), part.y, part.rows, corrected + margin_,
                       brick_plane, stride_};
        kernel.refine_planes(order_, stencil_.data(), from, part.rows, fine_.row(), brick);

        while (end != all && end->x - reach_ < brick.x + brick.planes) ++end;
        while (begin != end && begin->x + reach_ < brick.x) ++begin;
        kernel.correct(begin, end, reach_, brick);
        write(brick, out);
    }
}

}  // namespace sono

// An explicit operator of a coarse grid: 3 x 3 blocks to a node and its 26 neighbours, of which half are stored.
#include "elasticity/elastic_kernels.hpp"

#include <cstring>
#include <utility>

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr int kWidth = lanes<float>;

// The values kShift places before those of `now`, whose predecessors are `before`.
template <int kShift, int... I> inline VecF delayed(VecF before, VecF now, std::integer_sequence<int, I...>) {
    return __builtin_shufflevector(before, now, (kWidth - kShift + I)...);
}
using Lanes = std::make_integer_sequence<int, kWidth>;

// Forces at the nodes of two planes in turn, in the scratch of a sweep: three components, zeros around them.
class PlaneForces {
  public:
    PlaneForces(const ElasticSweep &work, std::ptrdiff_t row)
        : component_(static_cast<std::ptrdiff_t>(stencil_scratch(work.last, row) / 6)),
          now_(work.scratch + stencil_margin(row)), next_(now_ + 3 * component_) {
        clear(now_ - stencil_margin(row), 6);
    }
    float *now(int a) const { return now_ + a * component_; }
    float *next(int a) const { return next_ + a * component_; }
    void advance(std::ptrdiff_t row) {
        std::swap(now_, next_);
        clear(next_ - stencil_margin(row), 3);
    }

  private:
    void clear(float *from, std::ptrdiff_t components) {
        std::memset(from, 0, sizeof(float) * static_cast<std::size_t>(components * component_));
    }
    std::ptrdiff_t component_;
    float *now_, *next_;
};

// The blocks of a plane of nodes. Each is loaded once: by it a neighbour pushes the node, and by its transpose the node
// pushes that neighbour.
class StencilPlane {
  public:
    StencilPlane(const ElasticStencil &stencil, const ElasticSweep &work, std::size_t i)
        : row_(stencil.row), plane_(stencil.plane), component_(stencil.component), stride_(stencil.stride),
          end_(work.last + 2),  // what is pushed comes up to two places late
          blocks_(stencil.blocks + static_cast<std::ptrdiff_t>(i) * kStencilFloats * stencil.stride),
          in_(work.in + static_cast<std::ptrdiff_t>(i) * stencil.plane) {}

    // Adds the forces between nodes of the plane.
    void within(const PlaneForces &f) const {
        along_row(f);
        float *const now[3] = {f.now(0), f.now(1), f.now(2)};
        to_row<true>(2, row_, row_, now, now);
    }
    // Adds those between it and the next plane: on both, or on that alone.
    template <bool kBoth> void beyond(const PlaneForces &f) const {
        float *const now[3] = {f.now(0), f.now(1), f.now(2)}, *const next[3] = {f.next(0), f.next(1), f.next(2)};
        for (int y = -1; y <= 1; ++y)
            to_row<kBoth>(kStencilInPlane + 3 * (y + 1), plane_ + y * row_, y * row_, now, next);
    }

  private:
    // A node itself, and the next along z.
    void along_row(const PlaneForces &f) const {
        VecF before[3] = {};
        for (std::ptrdiff_t q = 0; q < end_; q += kWidth) {
            const float *const self = blocks_ + stencil_place(0, 2, q, stride_), *const after = self + 9 * kElasticLanes;
            VecF force[3], pushed[3] = {};
            for (int a = 0; a < 3; ++a) force[a] = load(f.now(a) + q);
            for (int b = 0; b < 3; ++b) {
                const VecF value = load(in_ + b * component_ + q), other = load(in_ + b * component_ + q + 1);
                for (int a = 0; a < 3; ++a) {
                    force[a] += load(self + (3 * a + b) * kElasticLanes) * value;
                    force[a] += load(after + (3 * a + b) * kElasticLanes) * other;
                    pushed[a] += load(after + (3 * b + a) * kElasticLanes) * value;
                }
            }
            for (int a = 0; a < 3; ++a) {
                store(f.now(a) + q, force[a] + delayed<1>(before[a], pushed[a], Lanes{}));
                before[a] = pushed[a];
            }
        }
    }

    // Three neighbours in another row, whose values are `apart` from the middle one's node; what they are pushed goes to
    // `to`, as far from it as `shift`. What pushes the node itself goes to `own` where kOwn.
    template <bool kOwn>
    void to_row(int number, std::ptrdiff_t apart, std::ptrdiff_t shift, float *const own[3], float *const to[3]) const {
        const float *const there = in_ + apart - 1;
        VecF first[3] = {}, second[3] = {};  // pushed on the middle and the last neighbour of the nodes before
        for (std::ptrdiff_t q = 0; q < end_; q += kWidth) {
            const float *const blocks = blocks_ + stencil_place(number, 3, q, stride_);
            VecF force[3] = {}, pushed[3][3] = {};
            for (int b = 0; b < 3; ++b) {
                const VecF value = load(in_ + b * component_ + q);
                for (int n = 0; n < 3; ++n) {
                    const float *const block = blocks + 9 * n * kElasticLanes;
                    const VecF other = kOwn ? load(there + b * component_ + q + n) : VecF{};
                    for (int a = 0; a < 3; ++a) {
                        if (kOwn) force[a] += load(block + (3 * a + b) * kElasticLanes) * other;
                        pushed[n][a] += load(block + (3 * b + a) * kElasticLanes) * value;
                    }
                }
            }
            for (int a = 0; a < 3; ++a) {
                if (kOwn) store(own[a] + q, load(own[a] + q) + force[a]);
                float *const target = to[a] + q + shift - 1;
                store(target, load(target) + (pushed[0][a] + delayed<1>(first[a], pushed[1][a], Lanes{}) +
                                              delayed<2>(second[a], pushed[2][a], Lanes{})));
                first[a] = pushed[1][a], second[a] = pushed[2][a];
            }
        }
    }

    const std::ptrdiff_t row_, plane_, component_, stride_, end_;
    const float *const blocks_, *const in_;
};

template <Sweep kSweep> void sweep_of(const ElasticStencil &stencil, const ElasticSweep &work) {
    PlaneForces forces(work, stencil.row);
    if (work.begin) {
        StencilPlane(stencil, work, work.begin - 1).beyond<false>(forces);
        forces.advance(stencil.row);
    }
    for (std::size_t i = work.begin; i < work.end; ++i, forces.advance(stencil.row)) {
        const StencilPlane plane(stencil, work, i);
        plane.within(forces);
        if (i + 1 < stencil.planes) plane.beyond<true>(forces);
        const std::ptrdiff_t start = static_cast<std::ptrdiff_t>(i) * stencil.plane;
        for (std::ptrdiff_t q = 0; q < work.last; q += kWidth) {  // beyond the last node blocks and diagonal are zero
            for (int a = 0; a < 3; ++a) {
                const std::ptrdiff_t at = a * stencil.component + start + q;
                const VecF force = load(forces.now(a) + q);
                if constexpr (kSweep == Sweep::product) {
                    store(work.out + at, force);
                } else {
                    const VecF inverse = load(work.inverse_diagonal + at), missing = load(work.b + at) - force;
                    if constexpr (kSweep == Sweep::residual)
                        store(work.out + at, inverse > 0.f ? missing : VecF{});
                    else
                        store(work.d + at, work.momentum * load(work.d + at) + work.step * inverse * missing);
                }
            }
        }
    }
    if constexpr (kSweep == Sweep::smooth)  // once all is read: `out` may be `in`
        for (int a = 0; a < 3; ++a)
            for (std::size_t i = work.begin; i < work.end; ++i) {
                const std::ptrdiff_t at = a * stencil.component + static_cast<std::ptrdiff_t>(i) * stencil.plane;
                for (std::ptrdiff_t q = 0; q < work.last; q += kWidth)
                    store(work.out + at + q, load(work.in + at + q) + load(work.d + at + q));
            }
}

void sweep(Sweep kind, const ElasticStencil &stencil, const ElasticSweep &work) {
    switch (kind) {
        case Sweep::product: return sweep_of<Sweep::product>(stencil, work);
        case Sweep::residual: return sweep_of<Sweep::residual>(stencil, work);
        default: return sweep_of<Sweep::smooth>(stencil, work);
    }
}

}  // namespace

extern const StencilKernels stencil;
const StencilKernels stencil = {sweep};

}  // namespace SONO_ISA
}  // namespace sono

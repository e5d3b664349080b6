// An explicit operator of a coarse grid: 3 x 3 blocks to a node and its 26 neighbours, of which half are stored.
#include "elasticity/elastic_kernels.hpp"

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr int kWidth = lanes<float>;

// The blocks of a plane of nodes, and the values they are multiplied with.
class StencilPlane {
  public:
    StencilPlane(const ElasticStencil &stencil, const float *in, std::size_t i)
        : row_(stencil.row), plane_(stencil.plane), component_(stencil.component), stride_(stencil.stride),
          blocks_(stencil.blocks + static_cast<std::ptrdiff_t>(i) * kStencilFloats * stencil.stride),
          in_(in + static_cast<std::ptrdiff_t>(i) * stencil.plane), first_(i == 0), last_(i + 1 == stencil.planes) {}

    // Forces f at nodes q to q + kWidth.
    void forces(std::ptrdiff_t q, VecF f[3]) const {
        f[0] = f[1] = f[2] = VecF{};
        ahead(blocks_ + q, in_ + q, f);
        int number = 1;
        for (; number < kStencilInPlane; ++number) {
            const std::ptrdiff_t apart = distance(number);
            ahead(blocks_ + 9 * number * stride_ + q, in_ + q + apart, f);
            back(blocks_ + 9 * number * stride_ + q - apart, in_ + q - apart, f);
        }
        for (; number < kStencilHalf; ++number) {
            const std::ptrdiff_t apart = distance(number), block = 9 * number * stride_ + q;
            if (!last_) ahead(blocks_ + block, in_ + q + apart + plane_, f);
            if (!first_) back(blocks_ + block - apart - kStencilFloats * stride_, in_ + q - apart - plane_, f);
        }
    }

  private:
    // Floats within a plane from a node to neighbour `number` after it.
    std::ptrdiff_t distance(int number) const {
        const StencilOffset &to = kStencilOffsets[number];
        return to.y * row_ + to.z;
    }
    void ahead(const float *block, const float *values, VecF f[3]) const {
        for (int b = 0; b < 3; ++b) {
            const VecF value = load(values + b * component_);
            for (int a = 0; a < 3; ++a) f[a] += load(block + (3 * a + b) * stride_) * value;
        }
    }
    void back(const float *block, const float *values, VecF f[3]) const {
        for (int b = 0; b < 3; ++b) {
            const VecF value = load(values + b * component_);
            for (int a = 0; a < 3; ++a) f[a] += load(block + (3 * b + a) * stride_) * value;
        }
    }

    const std::ptrdiff_t row_, plane_, component_, stride_;
    const float *const blocks_, *const in_;
    const bool first_, last_;
};

template <Sweep kSweep> void sweep_of(const ElasticStencil &stencil, const ElasticSweep &work) {
    for (std::size_t i = work.begin; i < work.end; ++i) {
        const StencilPlane plane(stencil, work.in, i);
        const std::ptrdiff_t start = static_cast<std::ptrdiff_t>(i) * stencil.plane;
        for (std::ptrdiff_t q = 0; q < work.last; q += kWidth) {  // beyond the last node blocks and diagonal are zero
            VecF f[3];
            plane.forces(q, f);
            for (int a = 0; a < 3; ++a) {
                const std::ptrdiff_t at = a * stencil.component + start + q;
                if constexpr (kSweep == Sweep::product) {
                    store(work.out + at, f[a]);
                } else {
                    const VecF inverse = load(work.inverse_diagonal + at), missing = load(work.b + at) - f[a];
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

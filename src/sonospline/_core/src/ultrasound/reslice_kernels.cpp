// Compiled once per instruction set (SONO_ISA names it), like kernels.cpp.
#include "ultrasound/reslice_kernels.hpp"

#include <algorithm>

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

class Voxels {
  public:
    explicit Voxels(const VoxelImage &image)
        : image_(image), row_(static_cast<std::ptrdiff_t>(image.shape[2])),
          plane_(row_ * static_cast<std::ptrdiff_t>(image.shape[1])) {
        // where an axis has one voxel, the next is that one again
        const std::ptrdiff_t strides[3] = {plane_, row_, 1};
        for (int a = 0; a < 3; ++a) {
            last_[a] = static_cast<float>(image.shape[a] - 1);
            next_[a] = image.shape[a] > 1 ? strides[a] : 0;
        }
    }

    bool one(const float index[3], float &grey) const {
        std::ptrdiff_t at[3];
        float t[3];
        std::size_t nearest = 0;
        for (int a = 0; a < 3; ++a) {
            if (!(index[a] >= -0.5f && index[a] <= last_[a] + 0.5f)) return false;
            const float inside = std::min(std::max(index[a], 0.0f), last_[a]);
            at[a] = std::min(static_cast<std::ptrdiff_t>(inside), lowest_of_last(a));
            t[a] = inside - static_cast<float>(at[a]);
            nearest = nearest * image_.shape[a] + static_cast<std::size_t>(at[a] + (t[a] >= 0.5f));
        }
        if (image_.seen && !image_.seen[nearest]) return false;
        const float *corner = image_.grey + at[0] * plane_ + at[1] * row_ + at[2];
        const float low = face(corner, t), high = face(corner + next_[0], t);
        grey = low + t[0] * (high - low);
        return true;
    }

#if defined(__AVX2__)
    static constexpr int width = lanes<float>;
    typedef std::int32_t VecI __attribute__((vector_size(kBytes)));
    typedef std::uint8_t Bytes __attribute__((vector_size(kBytes / 4)));

    static VecF gather(const float *from, VecI at) {
#if defined(__AVX512F__)
        return (VecF)_mm512_i32gather_ps((__m512i)at, from, 4);
#else
        return (VecF)_mm256_i32gather_ps(from, (__m256i)at, 4);
#endif
    }

    // Places of one vector whose offsets fit 32 bits.
    void many(const float *const index[3], std::size_t n, float *grey, std::uint8_t *seen) const {
        VecI inside = VecI{} - 1, low[3], nearest{};
        VecF t[3];
        for (int a = 0; a < 3; ++a) {
            const VecF at = load(index[a] + n);
            inside &= (at >= -0.5f) & (at <= last_[a] + 0.5f);
            const VecF zero = splat(0.0f), end = splat(last_[a]);
            VecF held = at > 0.0f ? at : zero;
            held = held < last_[a] ? held : end;
            const VecI most = VecI{} + static_cast<std::int32_t>(lowest_of_last(a));
            low[a] = __builtin_convertvector(held, VecI);
            low[a] = low[a] < most ? low[a] : most;
            t[a] = held - __builtin_convertvector(low[a], VecF);
            nearest = nearest * static_cast<std::int32_t>(image_.shape[a]) + low[a] - (t[a] >= 0.5f);
        }
        const auto row = static_cast<std::int32_t>(row_), plane = static_cast<std::int32_t>(plane_);
        const VecI corner = (low[0] * plane + low[1] * row + low[2]) & inside;
        const auto along = [&](std::ptrdiff_t further) {
            const float *from = image_.grey + further;
            const VecF a = gather(from, corner), b = gather(from + next_[2], corner);
            return a + t[2] * (b - a);
        };
        const VecF a = along(0), b = along(next_[1]), c = along(next_[0]), d = along(next_[0] + next_[1]);
        const VecF near = a + t[1] * (b - a), far = c + t[1] * (d - c);
        const VecF value = near + t[0] * (far - near);
        if (image_.seen)
            for (int i = 0; i < width; ++i) inside[i] &= -(image_.seen[nearest[i] & inside[i]] != 0);
        store(grey + n, inside ? value : splat(0.0f));
        const Bytes shown = __builtin_convertvector(inside & 1, Bytes);
        std::memcpy(seen + n, &shown, sizeof shown);
    }
#endif

  private:
    float face(const float *at, const float t[3]) const {
        const float *const beside = at + next_[1];
        const float low = at[0] + t[2] * (at[next_[2]] - at[0]);
        const float high = beside[0] + t[2] * (beside[next_[2]] - beside[0]);
        return low + t[1] * (high - low);
    }

    // The first voxel of the last two along an axis.
    std::ptrdiff_t lowest_of_last(int a) const { return std::max<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(last_[a]) - 1, 0); }

    const VoxelImage image_;
    const std::ptrdiff_t row_, plane_;
    std::ptrdiff_t next_[3];
    float last_[3];
};

void sample(const VoxelImage &image, const float *const index[3], std::size_t n, float *grey, std::uint8_t *seen) {
    const Voxels voxels(image);
    std::size_t i = 0;
#if defined(__AVX2__)
    if (image.shape[0] * image.shape[1] * image.shape[2] < std::size_t(1) << 31)
        for (; i + Voxels::width <= n; i += Voxels::width) voxels.many(index, i, grey, seen);
#endif
    for (; i < n; ++i) {
        const float at[3] = {index[0][i], index[1][i], index[2][i]};
        grey[i] = 0;
        seen[i] = voxels.one(at, grey[i]);
    }
}

}  // namespace

extern const ResliceKernels reslice_kernels;
const ResliceKernels reslice_kernels = {sample};

}  // namespace SONO_ISA
}  // namespace sono

#include "reslice.hpp"

#include <algorithm>
#include <cmath>

#include "parallel.hpp"
#include "trilinear.hpp"

namespace sono {
namespace {

constexpr std::size_t kRowsPerBlock = 16;

class Voxels {
  public:
    explicit Voxels(const VoxelImage &image)
        : image_(image), row_(image.shape[2]), plane_(row_ * image.shape[1]) {
        for (int a = 0; a < 3; ++a) last_[a] = static_cast<float>(image.shape[a] - 1);
    }

    bool operator()(const float index[3], float &grey) const {
        std::ptrdiff_t at[3];
        float t[3];
        std::size_t nearest = 0;
        for (int a = 0; a < 3; ++a) {
            if (!(index[a] >= -0.5f && index[a] <= last_[a] + 0.5f)) return false;
            const float inside = std::min(std::max(index[a], 0.0f), last_[a]);
            at[a] = std::min(static_cast<std::ptrdiff_t>(inside), static_cast<std::ptrdiff_t>(last_[a]) - 1);
            t[a] = inside - static_cast<float>(at[a]);
            nearest = nearest * image_.shape[a] + static_cast<std::size_t>(at[a] + (t[a] >= 0.5f));
        }
        if (!image_.seen[nearest]) return false;
        const float *corner = image_.grey + at[0] * plane_ + at[1] * row_ + at[2];
        const float low = face(corner, t), high = face(corner + plane_, t);
        grey = low + t[0] * (high - low);
        return true;
    }

  private:
    float face(const float *at, const float t[3]) const {
        const float low = at[0] + t[2] * (at[1] - at[0]);
        const float high = at[row_] + t[2] * (at[row_ + 1] - at[row_]);
        return low + t[1] * (high - low);
    }

    const VoxelImage image_;
    std::ptrdiff_t row_, plane_;
    float last_[3];
};

}  // namespace

void reslice(const LatticeField &field, const VoxelImage &image, const PixelPlane &plane, double tolerance, int most,
             float *grey, std::uint8_t *seen) {
    const Trilinear<float> displacement(field);
    const Voxels voxels(image);
    const float enough = static_cast<float>(tolerance * tolerance);
    const auto row = [&](std::size_t r) {
        float u[3] = {};  // of the pixel before: close to this one's
        for (std::size_t c = 0; c < plane.columns; ++c) {
            float p[3], x[3], missing = 0;
            for (int a = 0; a < 3; ++a) {
                const double *step = plane.pixel + 3 * a;
                p[a] = static_cast<float>(step[0] * static_cast<double>(c) + step[1] * static_cast<double>(r) + step[2]);
                x[a] = p[a] - u[a];
            }
            bool found = false;
            for (int step = 0; step < most && !found; ++step) {
                displacement(x, u);
                missing = 0;
                for (int a = 0; a < 3; ++a) {
                    const float d = p[a] - u[a] - x[a];
                    missing += d * d;
                    x[a] += d;
                }
                found = missing <= enough;
            }
            float index[3];
            for (int a = 0; a < 3; ++a) {
                const double *m = plane.index + 4 * a;
                index[a] = static_cast<float>(m[0] * x[0] + m[1] * x[1] + m[2] * x[2] + m[3]);
            }
            const std::size_t at = r * plane.columns + c;
            grey[at] = 0;
            seen[at] = found && voxels(index, grey[at]);
            if (!found) std::fill_n(u, 3, 0.0f);
        }
    };
    parallel_for((plane.rows + kRowsPerBlock - 1) / kRowsPerBlock, [&](std::size_t block) {
        const std::size_t end = std::min(plane.rows, (block + 1) * kRowsPerBlock);
        for (std::size_t r = block * kRowsPerBlock; r < end; ++r) row(r);
    });
}

}  // namespace sono

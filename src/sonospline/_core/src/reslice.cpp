#include "reslice.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "trilinear4.hpp"

namespace sono {
namespace {

constexpr std::size_t kRowsPerBlock = 32;

/// The displacement found at a pixel, and how it changed from the pixel above.
struct Guess {
    Float4 u{}, change{};
    bool known = false;
};

class Voxels {
  public:
    explicit Voxels(const VoxelImage &image)
        : image_(image), row_(image.shape[2]), plane_(row_ * image.shape[1]) {
        for (int a = 0; a < 3; ++a) last_[a] = static_cast<float>(image.shape[a] - 1);
    }

    bool operator()(Float4 index, float &grey) const {
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
    const Trilinear4 displacement(field);
    const Voxels voxels(image);
    const float enough = static_cast<float>(tolerance * tolerance);
    Float4 along{}, down{}, corner{}, index[4] = {};
    for (int a = 0; a < 3; ++a) {
        along[a] = static_cast<float>(plane.pixel[3 * a]), down[a] = static_cast<float>(plane.pixel[3 * a + 1]);
        corner[a] = static_cast<float>(plane.pixel[3 * a + 2]);
        for (int b = 0; b < 4; ++b) index[b][a] = static_cast<float>(plane.index[4 * a + b]);
    }
    // Starts from the pixel above: from the one before it, no two pixels could be under way at once.
    const auto row = [&](std::size_t r, Guess *guesses) {
        for (std::size_t c = 0; c < plane.columns; ++c) {
            Guess &guess = guesses[c];
            const Float4 p = corner + static_cast<float>(c) * along + static_cast<float>(r) * down;
            Float4 x = p - guess.u - guess.change, u{};
            bool found = false;
            for (int step = 0; step < most && !found; ++step) {
                u = displacement(x);
                const Float4 d = p - u - x, squared = d * d;
                x += d;
                found = squared[0] + squared[1] + squared[2] <= enough;
            }
            const Float4 voxel = index[0] * x[0] + index[1] * x[1] + index[2] * x[2] + index[3];
            const std::size_t at = r * plane.columns + c;
            grey[at] = 0;
            seen[at] = found && voxels(voxel, grey[at]);
            guess.change = guess.known && found ? u - guess.u : Float4{};
            guess.u = found ? u : Float4{};
            guess.known = found;
        }
    };
    parallel_for((plane.rows + kRowsPerBlock - 1) / kRowsPerBlock, [&](std::size_t block) {
        const std::size_t end = std::min(plane.rows, (block + 1) * kRowsPerBlock);
        std::vector<Guess> guesses(plane.columns);
        for (std::size_t r = block * kRowsPerBlock; r < end; ++r) row(r, guesses.data());
    });
}

}  // namespace sono

#include "ultrasound/reslice.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "fields/trilinear4.hpp"

namespace sono {
namespace {

constexpr std::size_t kStep = 4;  // pixels between those at which the inverse map is found: a vector of them
constexpr std::size_t kRowsPerBlock = 32;

/// A displacement found at a pixel of the image, and the voxel it leads to.
struct Found {
    Float4 u{}, voxel{};
    bool known = false;
};

float squared(Float4 v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

/// The inverse map along a plane.
class Inverse {
  public:
    Inverse(const LatticeField &field, const PixelPlane &plane, double tolerance, int most)
        : displacement_(field), enough_(static_cast<float>(tolerance * tolerance)), most_(most) {
        for (int a = 0; a < 3; ++a) {
            along_[a] = static_cast<float>(plane.pixel[3 * a]), down_[a] = static_cast<float>(plane.pixel[3 * a + 1]);
            corner_[a] = static_cast<float>(plane.pixel[3 * a + 2]);
            offset_[a] = static_cast<float>(plane.index[4 * a + 3]);
            for (int b = 0; b < 3; ++b) turn_[b][a] = static_cast<float>(plane.index[4 * a + b]);
        }
    }
    Float4 pixel(float row, float column) const { return corner_ + column * along_ + row * down_; }

    // By x <- p - u(x).
    Found at(float row, float column, Float4 guess) const {
        const Float4 p = pixel(row, column);
        Float4 x = p - guess;
        for (int step = 0; step < most_; ++step) {
            const Float4 u = displacement_(x), change = p - u - x;
            x += change;
            if (squared(change) <= enough_) return {u, voxel(p - u), true};
        }
        return {};
    }
    Float4 voxel(Float4 x) const { return offset_ + turn_[0] * x[0] + turn_[1] * x[1] + turn_[2] * x[2]; }
    // Whether blocks are small beside the cells of the field, so that a look at the middle tells how it bends.
    bool fine(const LatticeField &field) const {
        const double block = kStep * std::sqrt(std::max(squared(along_), squared(down_)));
        return 2 * block <= *std::min_element(field.spacing.begin(), field.spacing.end());
    }
    bool close(Float4 a, Float4 b) const { return squared(a - b) <= enough_; }

  private:
    const Trilinear4 displacement_;
    const float enough_;
    const int most_;
    Float4 along_{}, down_{}, corner_{}, offset_{}, turn_[3] = {};
};

/// A band of rows: found at every fourth pixel, linear between where that is good enough.
class Band {
  public:
    Band(const Inverse &inverse, bool fine, std::size_t first, std::size_t rows, std::size_t columns)
        : inverse_(inverse), first_(first), across_(columns / kStep + 2) {
        const std::size_t down = (rows + kStep - 1) / kStep + 1;
        nodes_.resize(down * across_);
        linear_.resize((down - 1) * (across_ - 1));
        for (std::size_t r = 0; r < down; ++r)
            for (std::size_t c = 0; c < across_; ++c) {
                const Float4 guess = r ? node(r - 1, c).u : c ? node(r, c - 1).u : Float4{};
                nodes_[r * across_ + c] = inverse.at(row_of(r), column_of(c), guess);
            }
        for (std::size_t r = 0; fine && r + 1 < down; ++r)
            for (std::size_t c = 0; c + 1 < across_; ++c) {
                const Found &a = node(r, c), &b = node(r, c + 1), &d = node(r + 1, c), &e = node(r + 1, c + 1);
                if (!(a.known && b.known && d.known && e.known)) continue;
                const Float4 middle = 0.25f * (a.u + b.u + d.u + e.u);
                const Found found = inverse.at(row_of(r) + 0.5f * kStep, column_of(c) + 0.5f * kStep, middle);
                linear_[r * (across_ - 1) + c] = found.known && inverse.close(found.u, middle);
            }
    }

    // Voxel indices (3 rows of whole blocks of columns) along one row; NaN where there are none.
    void row(std::size_t number, float *const at[3]) const {
        const std::size_t r = number / kStep;
        const float t = static_cast<float>(number % kStep) / kStep;
        const auto between = [&](std::size_t c) { return node(r, c).voxel + t * (node(r + 1, c).voxel - node(r, c).voxel); };
        constexpr Float4 quarters = {0, 0.25f, 0.5f, 0.75f};
        Float4 left = between(0);
        for (std::size_t c = 0; c + 1 < across_; ++c) {
            const Float4 right = between(c + 1), change = right - left;
            for (int a = 0; a < 3; ++a) {
                const Float4 four = left[a] + quarters * change[a];
                std::memcpy(at[a] + c * kStep, &four, sizeof four);
            }
            if (!linear_[r * (across_ - 1) + c]) one_by_one(number, c, at);
            left = right;
        }
    }

  private:
    const Found &node(std::size_t r, std::size_t c) const { return nodes_[r * across_ + c]; }
    float row_of(std::size_t r) const { return static_cast<float>(first_ + r * kStep); }
    static float column_of(std::size_t c) { return static_cast<float>(c * kStep); }

    void one_by_one(std::size_t number, std::size_t c, float *const at[3]) const {
        Float4 u = node(number / kStep, c).u;
        for (std::size_t column = c * kStep; column < (c + 1) * kStep; ++column) {
            const Found found = inverse_.at(static_cast<float>(first_ + number), static_cast<float>(column), u);
            if (found.known) u = found.u;
            for (int a = 0; a < 3; ++a)
                at[a][column] = found.known ? found.voxel[a] : std::numeric_limits<float>::quiet_NaN();
        }
    }

    const Inverse &inverse_;
    const std::size_t first_, across_;
    std::vector<Found> nodes_;
    std::vector<char> linear_;
};

}  // namespace

void reslice(const LatticeField &field, const VoxelImage &image, const PixelPlane &plane, double tolerance, int most,
             float *grey, std::uint8_t *seen) {
    const ResliceKernels &kernel = *kernels().reslice;
    const Inverse inverse(field, plane, tolerance, most);
    const bool fine = inverse.fine(field);
    parallel_for((plane.rows + kRowsPerBlock - 1) / kRowsPerBlock, [&](std::size_t block) {
        const std::size_t first = block * kRowsPerBlock, n = plane.columns;
        const std::size_t rows = std::min(plane.rows, first + kRowsPerBlock) - first;
        const Band band(inverse, fine, first, rows, n);
        const std::size_t stride = n + 2 * kStep;
        std::vector<float> memory(3 * stride);
        float *const at[3] = {memory.data(), memory.data() + stride, memory.data() + 2 * stride};
        for (std::size_t r = 0; r < rows; ++r) {
            band.row(r, at);
            const std::size_t to = (first + r) * n;
            kernel.sample(image, at, n, grey + to, seen + to);
        }
    });
}

}  // namespace sono

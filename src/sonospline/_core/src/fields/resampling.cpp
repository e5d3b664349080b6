#include "fields/resampling.hpp"

#include <algorithm>
#include <array>

#include "common/buffers.hpp"
#include "common/kernels.hpp"
#include "common/phases.hpp"
#include "common/row_kernels.hpp"

namespace sono {
namespace {

constexpr std::size_t kRowsPerBlock = 4;
constexpr std::size_t kPlanesPerBlock = 4;

const RowKernels &inner() { return *kernels().rows; }

// out[i] = sum over j of weights(i, j) in[j], rows of n floats.
void apply(const AxisWeights &weights, const float *in, std::size_t in_stride, float *out, std::size_t out_stride,
           std::size_t n) {
    std::vector<const float *> rows(weights.columns());
    for (std::size_t j = 0; j < rows.size(); ++j) rows[j] = in + j * in_stride;
    for (std::size_t i = 0; i < weights.rows(); ++i)
        inner().combine(static_cast<int>(weights.count(i)), weights.at(i), rows.data() + weights.first(i),
                        out + i * out_stride, n, false);
}

}  // namespace

AxisWeights::AxisWeights(const float *data, std::size_t rows, std::size_t columns) : data_(data), columns_(columns) {
    for (std::size_t i = 0; i < rows; ++i) {
        const float *const row = data + i * columns;
        std::size_t first = 0, last = columns;
        while (first + 1 < columns && row[first] == 0) ++first;
        while (last > first + 1 && row[last - 1] == 0) --last;
        first_.push_back(first), count_.push_back(last - first);
    }
}

// Between knots two nodes from the ends the third derivative jumps, at those next to the ends it does not: that makes
// the third coefficient from either end an explicit sum, and leaves a tridiagonal system between them.
void spline_coefficients(const float *values, std::size_t stride, std::size_t nodes, std::size_t n, float *out) {
    const auto v = [&](std::size_t i) { return values + i * stride; };
    const auto c = [&](std::size_t i) { return out + i * n; };
    const auto three = [&](const std::array<float, 3> &w, const std::array<const float *, 3> &rows, float *to) {
        inner().combine(3, w.data(), rows.data(), to, n, false);
    };
    const auto two = [&](const std::array<float, 2> &w, const std::array<const float *, 2> &rows, float *to) {
        inner().combine(2, w.data(), rows.data(), to, n, false);
    };
    const std::array<float, 3> explicitly = {8 / 6.f, -1 / 6.f, -1 / 6.f}, outwards = {6, -4, -1};
    const std::size_t last = nodes - 1;
    three(explicitly, {v(1), v(0), v(2)}, c(2));
    three(explicitly, {v(last - 1), v(last), v(last - 2)}, c(last));
    std::vector<float> pivot(nodes, 0.f);
    for (std::size_t k = 3; k < last; ++k) {
        pivot[k] = 1 / (4 - pivot[k - 1]);
        two({6 * pivot[k], -pivot[k]}, {v(k - 1), c(k - 1)}, c(k));
    }
    for (std::size_t k = last - 1; k > 2; --k) two({1, -pivot[k]}, {c(k), c(k + 1)}, c(k));
    three(outwards, {v(1), c(2), c(3)}, c(1));
    three(outwards, {v(0), c(1), c(2)}, c(0));
    three(outwards, {v(last - 1), c(last), c(last - 1)}, c(nodes));
    three(outwards, {v(last), c(nodes), c(last)}, c(nodes + 1));
}

void resample_lattice(const Resampling &w, const float *values, float *out) {
    const std::size_t nx = w.x.columns() - 2, ny = w.y.columns() - 2, nz = w.nz, row = 3 * w.mz;
    const std::size_t my = w.y.rows(), plane = my * row;
    Buffer<float> planes(nx * plane);
    std::vector<const float *> to_z(nz);
    for (std::size_t k = 0; k < nz; ++k) to_z[k] = w.z_transposed + k * w.mz;
    const auto along_z_and_y = [&](std::size_t block) {
        std::vector<float> lines(3 * w.mz), rows(ny * row), filtered((ny + 2) * row);
        for (std::size_t i = block * kPlanesPerBlock; i < std::min(nx, (block + 1) * kPlanesPerBlock); ++i) {
            for (std::size_t j = 0; j < ny; ++j) {
                for (std::size_t a = 0; a < 3; ++a)
                    inner().combine(static_cast<int>(nz), values + ((a * nx + i) * ny + j) * nz, to_z.data(),
                                    lines.data() + a * w.mz, w.mz, false);
                float *const to = rows.data() + j * row;
                for (std::size_t k = 0; k < w.mz; ++k)
                    for (std::size_t a = 0; a < 3; ++a) to[3 * k + a] = lines[a * w.mz + k];
            }
            spline_coefficients(rows.data(), row, ny, row, filtered.data());
            apply(w.y, filtered.data(), row, planes.data() + i * plane, row, row);
        }
    };
    const auto along_x = [&](std::size_t block) {
        const std::size_t first = block * kRowsPerBlock, n = (std::min(my, first + kRowsPerBlock) - first) * row;
        std::vector<float> filtered((nx + 2) * n);
        spline_coefficients(planes.data() + first * row, plane, nx, n, filtered.data());
        apply(w.x, filtered.data(), n, out + first * row, plane, n);
    };
    parallel_phases({(nx + kPlanesPerBlock - 1) / kPlanesPerBlock, (my + kRowsPerBlock - 1) / kRowsPerBlock},
                    [&](std::size_t phase, std::size_t block) { phase ? along_x(block) : along_z_and_y(block); });
}

}  // namespace sono

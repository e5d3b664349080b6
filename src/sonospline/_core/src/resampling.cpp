#include "resampling.hpp"

#include <algorithm>

#include "buffers.hpp"
#include "elastic_kernels.hpp"
#include "kernels.hpp"
#include "phases.hpp"

namespace sono {
namespace {

constexpr std::size_t kRowsPerBlock = 4;
constexpr std::size_t kPlanesPerBlock = 4;

const ElasticKernels &inner() { return *kernels().elastic; }

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

void resample_lattice(const Resampling &w, const float *values, float *out) {
    const std::size_t nx = w.x_filter.columns(), ny = w.y_filter.columns(), nz = w.nz, row = 3 * w.mz;
    const std::size_t my = w.y.rows(), plane = my * row;
    Buffer<float> planes(nx * plane);
    std::vector<const float *> to_z(nz);
    for (std::size_t k = 0; k < nz; ++k) to_z[k] = w.z_transposed + k * w.mz;
    const auto along_z_and_y = [&](std::size_t block) {
        std::vector<float> lines(3 * w.mz), rows(ny * row), filtered(w.y_filter.rows() * row);
        for (std::size_t i = block * kPlanesPerBlock; i < std::min(nx, (block + 1) * kPlanesPerBlock); ++i) {
            for (std::size_t j = 0; j < ny; ++j) {
                for (std::size_t a = 0; a < 3; ++a)
                    inner().combine(static_cast<int>(nz), values + ((a * nx + i) * ny + j) * nz, to_z.data(),
                                    lines.data() + a * w.mz, w.mz, false);
                float *const to = rows.data() + j * row;
                for (std::size_t k = 0; k < w.mz; ++k)
                    for (std::size_t a = 0; a < 3; ++a) to[3 * k + a] = lines[a * w.mz + k];
            }
            apply(w.y_filter, rows.data(), row, filtered.data(), row, row);
            apply(w.y, filtered.data(), row, planes.data() + i * plane, row, row);
        }
    };
    const auto along_x = [&](std::size_t block) {
        const std::size_t first = block * kRowsPerBlock, n = (std::min(my, first + kRowsPerBlock) - first) * row;
        std::vector<float> filtered(w.x_filter.rows() * n);
        apply(w.x_filter, planes.data() + first * row, plane, filtered.data(), n, n);
        apply(w.x, filtered.data(), n, out + first * row, plane, n);
    };
    parallel_phases({(nx + kPlanesPerBlock - 1) / kPlanesPerBlock, (my + kRowsPerBlock - 1) / kRowsPerBlock},
                    [&](std::size_t phase, std::size_t block) { phase ? along_x(block) : along_z_and_y(block); });
}

}  // namespace sono

// From the nodes of one lattice to those of another with the same axes, by weights along
// each axis: what tensor-product splines need.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace sono {

/// A matrix applied along an axis, with the columns of each row that are not zero.
class AxisWeights {
  public:
    AxisWeights(const float *data, std::size_t rows, std::size_t columns);
    std::size_t rows() const { return first_.size(); }
    std::size_t columns() const { return columns_; }
    std::size_t first(std::size_t row) const { return first_[row]; }
    std::size_t count(std::size_t row) const { return count_[row]; }
    const float *at(std::size_t row) const { return data_ + row * columns_ + first_[row]; }

  private:
    const float *data_;
    std::size_t columns_;
    std::vector<std::size_t> first_, count_;
};

/// Along x and y two matrices one after the other (a prefilter, then few weights a node); along
/// z their product, transposed (columns, rows). values (3, nx, ny, nz), out (mx, my, mz, 3).
struct Resampling {
    AxisWeights x_filter, x, y_filter, y;
    const float *z_transposed;
    std::size_t nz, mz;
};

void resample_lattice(const Resampling &weights, const float *values, float *out);

}  // namespace sono

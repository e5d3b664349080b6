// From the nodes of one lattice to those of another with the same axes, by tensor-product
// cubic splines.
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

/// Along x and y, weights of the B-splines, whose coefficients are found first; along z, where rows are short, one
/// matrix that does both, transposed (columns, rows). values (3, nx, ny, nz), out (mx, my, mz, 3).
struct Resampling {
    AxisWeights x, y;
    const float *z_transposed;
    std::size_t nz, mz;
};

/// B-spline coefficients (nodes + 2 rows) of the not-a-knot spline through values (nodes rows) of n floats; 4 nodes or
/// more.
void spline_coefficients(const float *values, std::size_t stride, std::size_t nodes, std::size_t n, float *out);

void resample_lattice(const Resampling &weights, const float *values, float *out);

}  // namespace sono

// Loops over rows of floats, as the elastic solver and resampling need them; compiled once per instruction set.
#pragma once

#include <cstddef>

namespace sono {

/// A force per volume along a line, by place along it in smoothing lengths sqrt(2) a: a sum of error functions, which
/// are smoothed steps, and a Gaussian at the tip; a Gaussian across it.
struct LineLoad {
    float direction[3];
    const float *places, *halves;  // of the steps; half of each
    std::size_t steps;
    float depth, tip;
    float per_length;  // smoothing lengths
};

struct RowKernels {
    /// x += factor y, over n floats
    void (*add)(float factor, const float *y, float *x, std::size_t n);
    /// x = y + factor x
    void (*extend)(float factor, const float *y, float *x, std::size_t n);
    /// x += factor y where mask > 0
    void (*add_masked)(float factor, const float *y, const float *mask, float *x, std::size_t n);
    /// Sum of the lengths of n vectors.
    double (*lengths)(const float *x, const float *y, const float *z, std::size_t n);
    /// out[i] = sum over j of weight[j] rows[j][i], i < n, j < count; added to what is there where `more`
    void (*combine)(int count, const float *weight, const float *const *rows, float *out, std::size_t n, bool more);
    /// The load at n points from `start` on, relative to the line's origin, `step` apart along z.
    void (*line_row)(const LineLoad &, const float start[3], float step, std::size_t n, float *out);
};

}  // namespace sono

// Loops over rows of floats, as the elastic solver, its load and resampling need them; compiled once per instruction set.
#pragma once

#include <cstddef>

namespace sono {

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
};

}  // namespace sono

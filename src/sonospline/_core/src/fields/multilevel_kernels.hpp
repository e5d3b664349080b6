// The hot loops of the multilevel sum, compiled once per instruction set. Values lie
// as the result does, x y z of one node together: interpolation along any axis is then
// a combination of contiguous rows.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sono {

constexpr int kLanePad = 16;    // coarsest planes are padded to it; every vector width divides it
constexpr int kMaxPlanes = 6;   // coarsest planes summed together
constexpr int kRun = 16;        // nodes in one run of a correction table
constexpr int kPairs = 3;       // pairs of an even and an odd plane interpolated together
constexpr int kRowSlack = 128;  // floats that may be read or written past a row's end
constexpr int kMaxOrder = 12;

/// Landmarks in units of the spacing along x, sorted by x. Weights: 4 floats each, the last 0.
struct Sources {
    const float *x, *y, *z, *half_weights;
    std::size_t count;
};

/// Some planes of the coarsest lattice; nodes of a plane are numbered y nz + z.
struct CoarsePlanes {
    int planes;             // at most kMaxPlanes
    float x[kMaxPlanes];
    float *out[kMaxPlanes];
    const float *y, *z;     // of each node of a plane
    std::size_t first, last;  // nodes to fill, multiples of kLanePad
    const float *affine;    // (4, 3)
    float *scratch;         // kMaxPlanes * sources.count
};

/// Where kRun values of kernel minus interpolant begin, relative to the landmark.
struct Run {
    std::int16_t x, y, z;
};

/// The corrections of one parity class, by offset along x.
struct CorrectionTable {
    int first_x, count_x;
    const std::uint32_t *starts;  // count_x + 1 entries: first run of each offset
    const Run *runs;
    const float *values;  // kRun of each run
};

/// A landmark as one level sees it.
struct Placed {
    int x, y, z;  // the even node its table is relative to
    const CorrectionTable *table;
    const float *weight;  // 4 floats, readable up to a vector's width
};

/// Planes x to x + planes, rows y to y + rows of them; data holds node (x, y, 0).
struct Brick {
    int x, planes, y, rows;
    float *data;
    std::size_t plane, row;  // floats from one to the next
};

/// Rows of equal length at a fixed stride.
template <class T> struct Rows {
    T *data;
    std::size_t stride;
};

struct MultilevelKernels {
    /// affine part plus direct sum of U = r
    void (*coarse_sum)(const Sources &, const CoarsePlanes &);
    /// `coarse` holds the left-most node of the first pair's stencil; writes 2 * pairs nodes
    void (*refine_row)(int order, const float *stencil, const float *coarse, int pairs, float *fine);
    /// out = sum_m stencil[m] * in[m]
    void (*combine)(int order, const float *stencil, const float *const *in, std::size_t floats, float *out);
    /// The 2 kPairs planes that kPairs + order - 1 coarse planes `in` give, into `out`
    void (*refine_planes)(int order, const float *stencil, const Rows<const float> *in, int rows, std::size_t floats,
                          const Brick &out);
    /// Adds the corrections of [begin, end), none of them further than `reach` from its landmark
    void (*correct)(const Placed *begin, const Placed *end, int reach, const Brick &);
    /// `past_caches` writes around the caches, for results too large to stay in them
    void (*copy)(Rows<const float> in, Rows<float> out, int rows, std::size_t floats, bool past_caches);
};

}  // namespace sono

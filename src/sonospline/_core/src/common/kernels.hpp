// What each instruction set provides: sums of a radial kernel over centres, for
// one tile of evaluation points held as separate x, y, z arrays.
#pragma once

#include <cstddef>

namespace sono {

enum class Kernel : int { biharmonic = 0, triharmonic = 1 };  // U = r, U = r^3

constexpr int kTile = 64;  // points a tile; every vector width divides it

template <class T> struct Centres {
    const T *x, *y, *z;     // coordinates
    const T *wx, *wy, *wz;  // weights
    std::size_t count;
};

template <class T> struct Tile {
    alignas(64) T x[kTile], y[kTile], z[kTile];
};

/// K(x) = [spread / r_e + core / r_e^3] I + (axial / r_e^3) x x^T with r_e^2 = r^2 + width2: a regularised Kelvinlet.
struct Kelvinlet {
    double spread, core, axial, width2;
};

struct BmodeKernels;
struct BrickKernels;
struct CholeskyKernels;
struct EchoKernels;
struct MultilevelKernels;
struct ElasticKernels;
struct ElasticLayerKernels;
struct ResliceKernels;
struct RowKernels;
struct StencilKernels;

struct KernelTable {
    const char *name;
    const BmodeKernels *bmode;
    const BrickKernels *brick;
    const CholeskyKernels *cholesky;
    const EchoKernels *echo;
    const MultilevelKernels *multilevel;
    const ElasticKernels *elastic;
    const ElasticLayerKernels *elastic_layers;
    const ResliceKernels *reslice;
    const RowKernels *rows;
    const StencilKernels *stencil;
    /// out += sum_j w_j U(|p - c_j|)
    void (*sum_f32)(Kernel, const Tile<float> &points, const Centres<float> &, Tile<float> &out);
    void (*sum_f64)(Kernel, const Tile<double> &points, const Centres<double> &, Tile<double> &out);
    /// out[3a + b] = d u_a / d x_b of the same sum, kTile values each
    void (*gradient_f64)(Kernel, const Tile<double> &points, const Centres<double> &, double (*out)[kTile]);
    /// out = sum_j K(p - c_j) w_j
    void (*kelvinlet_f64)(const Kelvinlet &, const Tile<double> &points, const Centres<double> &, Tile<double> &out);
    /// out = U(|p - centre|)
    void (*values_f64)(Kernel, const Tile<double> &points, const double centre[3], double *out);
};

/// The table in use; the best one this machine can run unless chosen otherwise.
const KernelTable &kernels();
/// All tables this machine can run, best first.
const KernelTable *const *available_kernels(std::size_t &count);
/// False where the machine cannot run `name` or there is none of that name.
bool choose_kernels(const char *name);

}  // namespace sono

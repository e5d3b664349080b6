// Compiled once per instruction set (SONO_ISA names it). The loops hold a few
// vectors of points in registers and stream the centres past them.
#include "common/kernels.hpp"

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

template <Kernel K, class T> inline Vec<T> radial(Vec<T> r2) {
    const Vec<T> r = root<T>(r2).r;
    if constexpr (K == Kernel::triharmonic) return r2 * r;
    return r;
}

// U'(r) / r, so that grad U = (U'/r) (p - c)
template <Kernel K, class T> inline Vec<T> radial_slope(Vec<T> r2) {
    const Root<T> s = root<T>(r2);
    if constexpr (K == Kernel::triharmonic) return T(3) * s.r;
    return s.inverse;
}

template <Kernel K, class T>
void sum_tile(const Tile<T> &points, const Centres<T> &centres, Tile<T> &out) {
    constexpr int width = lanes<T>, group = width * kUnroll;
    for (int start = 0; start < kTile; start += group) {
        Vec<T> px[kUnroll], py[kUnroll], pz[kUnroll], ux[kUnroll], uy[kUnroll], uz[kUnroll];
        for (int u = 0; u < kUnroll; ++u) {
            const int at = start + u * width;
            px[u] = load(points.x + at), py[u] = load(points.y + at), pz[u] = load(points.z + at);
            ux[u] = load(out.x + at), uy[u] = load(out.y + at), uz[u] = load(out.z + at);
        }
        for (std::size_t j = 0; j < centres.count; ++j) {
            const T cx = centres.x[j], cy = centres.y[j], cz = centres.z[j];
            const T wx = centres.wx[j], wy = centres.wy[j], wz = centres.wz[j];
            for (int u = 0; u < kUnroll; ++u) {
                const Vec<T> dx = px[u] - cx, dy = py[u] - cy, dz = pz[u] - cz;
                const Vec<T> value = radial<K, T>(dx * dx + dy * dy + dz * dz);
                ux[u] += wx * value, uy[u] += wy * value, uz[u] += wz * value;
            }
        }
        for (int u = 0; u < kUnroll; ++u) {
            const int at = start + u * width;
            store(out.x + at, ux[u]), store(out.y + at, uy[u]), store(out.z + at, uz[u]);
        }
    }
}

template <Kernel K>
void gradient_tile(const Tile<double> &points, const Centres<double> &centres, double (*out)[kTile]) {
    for (int at = 0; at < kTile; at += lanes<double>) {
        const VecD px = load(points.x + at), py = load(points.y + at), pz = load(points.z + at);
        VecD sum[9] = {};
        for (std::size_t j = 0; j < centres.count; ++j) {
            const VecD dx = px - centres.x[j], dy = py - centres.y[j], dz = pz - centres.z[j];
            const VecD slope = radial_slope<K, double>(dx * dx + dy * dy + dz * dz);
            const VecD gradient[3] = {slope * dx, slope * dy, slope * dz};
            const double weight[3] = {centres.wx[j], centres.wy[j], centres.wz[j]};
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b) sum[3 * a + b] += weight[a] * gradient[b];
        }
        for (int c = 0; c < 9; ++c) store(out[c] + at, sum[c]);
    }
}

void kelvinlet(const Kelvinlet &k, const Tile<double> &points, const Centres<double> &centres, Tile<double> &out) {
    for (int at = 0; at < kTile; at += lanes<double>) {
        const VecD px = load(points.x + at), py = load(points.y + at), pz = load(points.z + at);
        VecD ux{}, uy{}, uz{};
        for (std::size_t j = 0; j < centres.count; ++j) {
            const double wx = centres.wx[j], wy = centres.wy[j], wz = centres.wz[j];
            const VecD dx = px - centres.x[j], dy = py - centres.y[j], dz = pz - centres.z[j];
            const VecD inverse = rsqrt(dx * dx + dy * dy + dz * dz + k.width2), cube = inverse * inverse * inverse;
            const VecD same = k.spread * inverse + k.core * cube;
            const VecD along = k.axial * cube * (dx * wx + dy * wy + dz * wz);
            ux += same * wx + along * dx, uy += same * wy + along * dy, uz += same * wz + along * dz;
        }
        store(out.x + at, ux), store(out.y + at, uy), store(out.z + at, uz);
    }
}

template <Kernel K> void values_tile(const Tile<double> &points, const double centre[3], double *out) {
    for (int at = 0; at < kTile; at += lanes<double>) {
        const VecD dx = load(points.x + at) - centre[0], dy = load(points.y + at) - centre[1],
                   dz = load(points.z + at) - centre[2];
        store(out + at, radial<K, double>(dx * dx + dy * dy + dz * dz));
    }
}

template <class T> void sum(Kernel kernel, const Tile<T> &p, const Centres<T> &c, Tile<T> &out) {
    kernel == Kernel::triharmonic ? sum_tile<Kernel::triharmonic, T>(p, c, out)
                                  : sum_tile<Kernel::biharmonic, T>(p, c, out);
}

void gradient(Kernel kernel, const Tile<double> &p, const Centres<double> &c, double (*out)[kTile]) {
    kernel == Kernel::triharmonic ? gradient_tile<Kernel::triharmonic>(p, c, out)
                                  : gradient_tile<Kernel::biharmonic>(p, c, out);
}

void values(Kernel kernel, const Tile<double> &p, const double centre[3], double *out) {
    kernel == Kernel::triharmonic ? values_tile<Kernel::triharmonic>(p, centre, out)
                                  : values_tile<Kernel::biharmonic>(p, centre, out);
}

#define SONO_TEXT(name) SONO_TEXT_(name)
#define SONO_TEXT_(name) #name

}  // namespace

extern const BmodeKernels bmode_kernels;
extern const BrickKernels brick_kernels;
extern const CholeskyKernels cholesky_kernels;
extern const EchoKernels echo_kernels;
extern const MultilevelKernels multilevel;
extern const ElasticKernels elastic;
extern const ElasticLayerKernels elastic_layers;
extern const ResliceKernels reslice_kernels;
extern const RowKernels rows;
extern const StencilKernels stencil;
extern const KernelTable table;
const KernelTable table = {SONO_TEXT(SONO_ISA), &bmode_kernels, &brick_kernels,  &cholesky_kernels,
                           &echo_kernels,       &multilevel,    &elastic,        &elastic_layers,
                           &reslice_kernels,    &rows,          &stencil,        sum<float>,
                           sum<double>,         gradient,       kelvinlet,       values};

}  // namespace SONO_ISA
}  // namespace sono

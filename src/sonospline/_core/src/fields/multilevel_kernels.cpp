// Compiled once per instruction set (SONO_ISA names it), like kernels.cpp.
#include "fields/multilevel_kernels.hpp"

#include <utility>

#include "common/vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr int kWidth = lanes<float>;

// --- direct sum on the coarsest lattice ---

// 2 sqrt(x), with the Newton step of 1/sqrt folded in: 3 operations after the estimate.
inline VecF twice_root(VecF x) {
    const VecF estimate = rsqrt_estimate(x);
    const VecF root = x * estimate;
    return root * (3.0f - root * estimate);
}

inline void interleave(const VecF value[3], float *out) {
    alignas(64) float plain[3][kWidth];
    for (int c = 0; c < 3; ++c) store(plain[c], value[c]);
    for (int i = 0; i < kWidth; ++i)
        for (int c = 0; c < 3; ++c) out[3 * i + c] = plain[c][i];
}

template <int P> void coarse_planes(const Sources &s, const CoarsePlanes &p) {
    // Keeps the estimate finite where a landmark lies on the node itself.
    constexpr float tiny = 1e-20f;
    for (std::size_t j = 0; j < s.count; ++j)
        for (int u = 0; u < P; ++u) p.scratch[P * j + u] = (p.x[u] - s.x[j]) * (p.x[u] - s.x[j]);
    for (std::size_t node = p.first; node < p.last; node += kWidth) {
        const VecF y = load(p.y + node), z = load(p.z + node);
        VecF sum[P][3];
        for (int u = 0; u < P; ++u)
            for (int c = 0; c < 3; ++c)
                sum[u][c] = p.affine[c] + p.affine[3 + c] * p.x[u] + p.affine[6 + c] * y + p.affine[9 + c] * z;
        for (std::size_t j = 0; j < s.count; ++j) {
            const VecF dy = y - s.y[j], dz = z - s.z[j];
            const VecF across = dy * dy + (dz * dz + tiny);
            const float *w = s.half_weights + 4 * j;
            for (int u = 0; u < P; ++u) {
                const VecF value = twice_root(across + p.scratch[P * j + u]);
                for (int c = 0; c < 3; ++c) sum[u][c] += w[c] * value;
            }
        }
        for (int u = 0; u < P; ++u) interleave(sum[u], p.out[u] + 3 * node);
    }
}

void coarse_sum(const Sources &s, const CoarsePlanes &p) {
    switch (p.planes) {
        case 1: return coarse_planes<1>(s, p);
        case 2: return coarse_planes<2>(s, p);
        case 3: return coarse_planes<3>(s, p);
        case 4: return coarse_planes<4>(s, p);
        case 5: return coarse_planes<5>(s, p);
        default: return coarse_planes<6>(s, p);
    }
}

// --- interpolation ---

// Calls body(integral_constant) for the order, which the inner loops unroll.
template <class Body> void with_order(int order, const Body &body) {
    switch (order) {
        case 4: return body(std::integral_constant<int, 4>{});
        case 6: return body(std::integral_constant<int, 6>{});
        case 8: return body(std::integral_constant<int, 8>{});
        case 10: return body(std::integral_constant<int, 10>{});
        default: return body(std::integral_constant<int, 12>{});
    }
}

// Where float f of interleaved even and odd nodes comes from, in either row.
constexpr int paired_source(int f) { return f / 6 * 3 + f % 3; }
constexpr int first_source(int v) {
    int first = paired_source(v * kWidth);
    for (int lane = 1; lane < kWidth; ++lane)
        if (paired_source(v * kWidth + lane) < first) first = paired_source(v * kWidth + lane);
    return first;
}
constexpr int pick(int v, int lane) {
    const int f = v * kWidth + lane;
    return paired_source(f) - first_source(v) + (f / 3 % 2 ? kWidth : 0);
}

using Lanes = std::make_integer_sequence<int, kWidth>;

template <int V, int... L>
inline VecF pair_up(const float *even, const float *odd, std::integer_sequence<int, L...>) {
    return __builtin_shufflevector(load(even + first_source(V)), load(odd + first_source(V)), pick(V, L)...);
}

template <int... V>
inline void pair_up_run(const float *even, const float *odd, float *fine, std::integer_sequence<int, V...>) {
    (store(fine + V * kWidth, pair_up<V>(even, odd, Lanes{})), ...);
}

// Even nodes are coarse nodes, odd ones lie midway between them.
void refine_row(int order, const float *stencil, const float *coarse, int pairs, float *fine) {
    with_order(order, [&](auto p) {
        constexpr int P = decltype(p)::value;
        for (int first = 0; first < pairs; first += kRun) {
            const float *from = coarse + 3 * first;
            alignas(64) float odd[3 * kRun + kWidth];  // the last lanes are loaded, never picked
            for (int at = 0; at < 3 * kRun; at += kWidth) {
                VecF sum = stencil[0] * load(from + at);
                for (int m = 1; m < P; ++m) sum += stencil[m] * load(from + at + 3 * m);
                store(odd + at, sum);
            }
            pair_up_run(from + 3 * (P / 2 - 1), odd, fine + 6 * first,
                        std::make_integer_sequence<int, 6 * kRun / kWidth>{});
        }
    });
}

void combine(int order, const float *stencil, const float *const *in, std::size_t floats, float *out) {
    with_order(order, [&](auto p) {
        constexpr int P = decltype(p)::value;
        for (std::size_t at = 0; at < floats; at += kWidth) {
            VecF sum = stencil[0] * load(in[0] + at);
            for (int m = 1; m < P; ++m) sum += stencil[m] * load(in[m] + at);
            store(out + at, sum);
        }
    });
}

// Several planes at once: each value is loaded once, not once per stencil it is part of.
void refine_planes(int order, const float *stencil, const Rows<const float> *in, int rows, std::size_t floats,
                   const Brick &out) {
    with_order(order, [&](auto p) {
        constexpr int P = decltype(p)::value, kPlanes = kPairs + P - 1;
        for (int row = 0; row < rows; ++row) {
            const float *from[kPlanes];
            for (int m = 0; m < kPlanes; ++m) from[m] = in[m].data + row * in[m].stride;
            float *to = out.data + row * out.row;
            for (std::size_t at = 0; at < floats; at += kWidth) {
                VecF plane[kPlanes];
                for (int m = 0; m < kPlanes; ++m) plane[m] = load(from[m] + at);
                for (int k = 0; k < kPairs; ++k) {
                    VecF odd = stencil[0] * plane[k];
                    for (int m = 1; m < P; ++m) odd += stencil[m] * plane[k + m];
                    store(to + at + 2 * k * out.plane, plane[k + P / 2 - 1]);
                    store(to + at + (2 * k + 1) * out.plane, odd);
                }
            }
        }
    });
}

// --- corrections ---

// Vector V of a row of nodes with 3 floats each: lane L is component (V W + L) mod 3 of
// node (V W + L) / 3.
constexpr int first_node(int v) { return v * kWidth / 3; }

template <int V, int... L> inline VecF spread(const float *nodes, std::integer_sequence<int, L...>) {
    const VecF value = load(nodes + first_node(V));
    return __builtin_shufflevector(value, value, ((V * kWidth + L) / 3 - first_node(V))...);
}

template <int V, int... L> inline VecF repeat(VecF xyz, std::integer_sequence<int, L...>) {
    return __builtin_shufflevector(xyz, xyz, ((V * kWidth + L) % 3)...);
}

template <int... V>
inline void add_run(const float *values, const VecF weight[3], float *out, std::integer_sequence<int, V...>) {
    (store(out + V * kWidth, load(out + V * kWidth) + weight[V % 3] * spread<V>(values, Lanes{})), ...);
}

template <bool kClipped> void add_runs(const Placed &p, std::uint32_t first, std::uint32_t last, const Brick &brick) {
    const VecF xyz = load(p.weight);
    const VecF weight[3] = {repeat<0>(xyz, Lanes{}), repeat<1>(xyz, Lanes{}), repeat<2>(xyz, Lanes{})};
    const std::ptrdiff_t plane = brick.plane, row = brick.row;
    float *const origin = brick.data + (p.x - brick.x) * plane + (p.y - brick.y) * row + 3 * p.z;
    const float *values = p.table->values + std::size_t(kRun) * first;
    for (const Run *run = p.table->runs + first; run != p.table->runs + last; ++run, values += kRun) {
        const int y = p.y + run->y - brick.y;
        if (kClipped && (y < 0 || y >= brick.rows)) continue;
        add_run(values, weight, origin + run->x * plane + run->y * row + 3 * run->z,
                std::make_integer_sequence<int, 3 * kRun / kWidth>{});
    }
}

void correct(const Placed *begin, const Placed *end, int reach, const Brick &brick) {
    for (const Placed *p = begin; p != end; ++p) {
        const CorrectionTable &table = *p->table;
        const int offset = brick.x - p->x - table.first_x;
        const int from = offset > 0 ? offset : 0;
        const int to = offset + brick.planes < table.count_x ? offset + brick.planes : table.count_x;
        if (from >= to) continue;
        const bool inside = p->y - reach >= brick.y && p->y + reach < brick.y + brick.rows;
        inside ? add_runs<false>(*p, table.starts[from], table.starts[to], brick)
               : add_runs<true>(*p, table.starts[from], table.starts[to], brick);
    }
}

// --- results ---

// Whole vectors around the caches, the ragged ends of the row as usual.
inline void stream_row(const float *from, float *to, std::size_t floats) {
    std::size_t at = 0;
    while (at < floats && reinterpret_cast<std::uintptr_t>(to + at) % kBytes) to[at] = from[at], ++at;
    for (; at + kWidth <= floats; at += kWidth) store_past_caches(to + at, load(from + at));
    for (; at < floats; ++at) to[at] = from[at];
}

void copy(Rows<const float> in, Rows<float> out, int rows, std::size_t floats, bool past_caches) {
    for (int row = 0; row < rows; ++row) {
        const float *from = in.data + row * in.stride;
        float *to = out.data + row * out.stride;
        past_caches ? stream_row(from, to, floats) : void(std::memcpy(to, from, floats * sizeof(float)));
    }
    if (past_caches) fence_past_caches();
}

}  // namespace

extern const MultilevelKernels multilevel;
const MultilevelKernels multilevel = {coarse_sum, refine_row, combine, refine_planes, correct, copy};

}  // namespace SONO_ISA
}  // namespace sono

// Compiled once per instruction set (SONO_ISA names it), like common/kernels.cpp: where scatterers lie in the beams,
// and the echo of each added to them.
#include <algorithm>
#include <cmath>

#include "ultrasound/bmode_kernels.hpp"
#include "ultrasound/float_vectors.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

// Chebyshev fits: sin and cos of 2 pi x for |x| <= 1/2 (1e-8), atan(x) / x for |x| <= 1 (2e-8),
// exp(-x/8) for x <= 4.5 (3e-10)
constexpr float kSin[] = {6.2831853f, -41.3417004f, 81.6051314f, -76.7030154f, 42.025927f, -14.8998467f, 3.23813751f};
constexpr float kCos[] = {0.999999989f, -19.7392045f, 64.9391175f, -85.4501395f, 60.167631f, -25.9675992f, 6.52865816f};
constexpr float kAtan[] = {0.999999984f, -0.333330668f, 0.199924836f,  -0.142025705f,  0.106367541f,
                           -0.0749544544f, 0.0425876075f, -0.0160050305f, 0.0028340643f};
constexpr float kExp[] = {1.0f, -0.124999993f, 0.00781247393f, -0.000325485719f, 1.01498857e-05f, -2.46742282e-07f,
                          4.01059632e-09f};

// and where |x| <= kNarrow: atan(x) / x and 1 / (1 + sqrt(1 + x^2)) as series in x^2 (7e-9)
constexpr float kNarrow = 0.125f;
constexpr float kAtanNarrow[] = {1.0f, -1 / 3.0f, 1 / 5.0f, -1 / 7.0f};
constexpr float kRootNarrow[] = {0.5f, -0.125f, 0.0625f, -0.0390625f};

inline VecF sqrt_of(VecF x) { return x * rsqrt(x); }  // of x >= 1

inline VecF exp_minus(VecF x) {  // 0 <= x <= 4.5
    VecF y = horner(x, kExp);
    y *= y;
    y *= y;
    return y * y;
}

// --- cells ---

inline V4 vector_at(const float *p) { return V4{p[0], p[1], p[2], 0.0f}; }

void place(const BeamGeometry &beam, const Cells &cells, const float *displacement, const float spacing[3],
           std::size_t first, std::size_t last, float *polynomials, LineSpan *spans) {
    for (std::size_t cell = first; cell < last; ++cell) {
        const CellFrame &frame = cells.frames[cell];
        const CellNodes &nodes = cells.nodes[cell];
        const float *corner = displacement + 3 * static_cast<std::ptrdiff_t>(nodes.first);
        const std::ptrdiff_t x = 3 * static_cast<std::ptrdiff_t>(nodes.step[0]),
                             y = 3 * static_cast<std::ptrdiff_t>(nodes.step[1]),
                             z = 3 * static_cast<std::ptrdiff_t>(nodes.step[2]);
        V4 c[8] = {vector_at(corner),         vector_at(corner + x),     vector_at(corner + y),
                   vector_at(corner + z),     vector_at(corner + x + y), vector_at(corner + x + z),
                   vector_at(corner + y + z), vector_at(corner + x + y + z)};
        // values at 000 100 010 001 110 101 011 111 -> coefficients of 1 u v w uv uw vw uvw
        c[7] += c[1] + c[2] + c[3] - c[0] - c[4] - c[5] - c[6];
        c[4] += c[0] - c[1] - c[2];
        c[5] += c[0] - c[1] - c[3];
        c[6] += c[0] - c[2] - c[3];
        for (int k = 1; k < 4; ++k) c[k] -= c[0];
        const float *r = frame.rotation;
        const V4 axis[3] = {{r[0], r[3], r[6], 0}, {r[1], r[4], r[7], 0}, {r[2], r[5], r[8], 0}};
        for (int k = 0; k < 8; ++k) c[k] = axis[0] * c[k][0] + axis[1] * c[k][1] + axis[2] * c[k][2];
        for (int a = 0; a < 3; ++a) c[1 + a] += axis[a] * spacing[a];
        float *out = polynomials + kPolynomialFloats * cell;
        for (int k = 0; k < 8; ++k) store4(out + 4 * k, c[k]);
        out[3] = 0;

        const V4 uv = c[0] + c[1] + c[2] + c[4], uw = c[0] + c[1] + c[3] + c[5], vw = c[0] + c[2] + c[3] + c[6];
        const V4 corners[8] = {c[0], c[0] + c[1], c[0] + c[2], c[0] + c[3], uv, uw, vw,
                               uv + c[3] + c[5] + c[6] + c[7]};
        V4 low = corners[0], high = corners[0];
        for (const V4 &p : corners) {
            low = p < low ? p : low;
            high = p > high ? p : high;
        }
        spans[cell] = {1, 0};
        const float away = std::fabs(frame.range - beam.focus_mm) + beam.margin_mm;
        const float cut = beam.cut_squared * (beam.focus_variance + beam.spread_squared * away * away);
        const float above = frame.elevation + low[1], below = frame.elevation + high[1];
        const float nearest = above > 0 ? above : below < 0 ? below : 0;
        if (!(nearest * nearest < cut) || frame.range + low[2] > beam.depth_mm + beam.margin_mm) continue;
        float left = low[0], right = high[0];
        if (beam.curved) {
            const float reach = frame.reach + low[2];
            if (reach <= 0.5f * (right - left)) {  // around the apex: any beam
                spans[cell] = {0, static_cast<std::int16_t>(beam.lines - 1)};
                continue;
            }
            left = std::min(left, 0.0f) / reach;  // |atan q| <= |q|
            right = std::max(right, 0.0f) / reach;
            out[3] = std::max(-left, right) < kNarrow;
        }
        const float from = frame.line + left * beam.lines_per_step - 1, to = frame.line + right * beam.lines_per_step + 1;
        if (!(to >= -1 && from <= static_cast<float>(beam.lines))) continue;  // also where they are no numbers
        spans[cell] = {static_cast<std::int16_t>(std::max(from, -1.0f)),
                       static_cast<std::int16_t>(std::min(to, static_cast<float>(beam.lines)))};
    }
}

// --- surfaces ---

// Squared elevation beyond which nothing in a cell is heard.
float widest_cut(const BeamGeometry &beam, const CellFrame &frame, const float *c) {
    float reach = std::fabs(frame.range - beam.focus_mm);
    for (int k = 0; k < 8; ++k) reach += std::fabs(c[4 * k]) + std::fabs(c[4 * k + 2]);
    return beam.cut_squared * (beam.focus_variance + beam.spread_squared * reach * reach);
}

void reflect(const BeamGeometry &beam, const Cells &cells, const Surfaces &surfaces, const float *polynomials,
             const LineSpan *spans, std::size_t first, std::size_t last, std::int16_t *amplitude) {
    const VecF step = splat(1.0f / 65536);
    const float to_units = 1 / cells.amplitude_step;
    for (std::size_t cell = first; cell < last; ++cell) {
        const std::int32_t from = surfaces.starts[cell], to = surfaces.starts[cell + 1];
        if (spans[cell].last < spans[cell].first) continue;
        std::copy(cells.amplitude + cells.starts[cell], cells.amplitude + cells.starts[cell + 1], amplitude + cells.starts[cell]);
        if (from == to) continue;
        const float *c = polynomials + kPolynomialFloats * cell;
        const std::int32_t scatterer = cells.starts[cell + 1] - (to - from);
        const float cut = widest_cut(beam, cells.frames[cell], c);
        for (std::int32_t at = from; at < to; at += kWidth) {
            const std::int32_t own = scatterer + at - from;
            const VecF u = (__builtin_convertvector(load_as<VecU16>(cells.u + own), VecF) + 0.5f) * step;
            const VecF v = (__builtin_convertvector(load_as<VecU16>(cells.v + own), VecF) + 0.5f) * step;
            const VecF w = (__builtin_convertvector(load_as<VecU16>(cells.w + own), VecF) + 0.5f) * step;
            const VecF elevation = cells.frames[cell].elevation + ((c[29] * w + c[17]) * v + (c[21] * w + c[5])) * u +
                                   ((c[25] * w + c[9]) * v + (c[13] * w + c[1]));
            if (!bits_of(elevation * elevation < cut)) continue;  // all beside the slice
            VecF x[3], y[3], z[3], place[3];  // the place's slopes along u, v and w
            for (int a = 0; a < 3; ++a) {
                const VecF mixed = c[28 + a] * w + c[16 + a];
                x[a] = mixed * v + (c[20 + a] * w + c[4 + a]);
                y[a] = mixed * u + (c[24 + a] * w + c[8 + a]);
                z[a] = (c[28 + a] * v + c[20 + a]) * u + (c[24 + a] * v + c[12 + a]);
                place[a] = x[a] * u + ((c[24 + a] * w + c[8 + a]) * v + (c[12 + a] * w + c[a]));
            }
            VecF normal[3];  // cofactors of the slopes times the undeformed one
            for (int a = 0; a < 3; ++a) {
                const int b = (a + 1) % 3, d = (a + 2) % 3;
                normal[a] = (y[b] * z[d] - y[d] * z[b]) * load(surfaces.normal[0] + at) +
                            (z[b] * x[d] - z[d] * x[b]) * load(surfaces.normal[1] + at) +
                            (x[b] * y[d] - x[d] * y[b]) * load(surfaces.normal[2] + at);
            }
            const VecF length = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] + 1e-20f;
            VecF along = normal[2] * normal[2] / length;  // squared cosine
            if (beam.curved) {
                const VecF q = clamp(place[0] / (place[2] + cells.frames[cell].reach), -1.0f, 1.0f);
                const VecF dot = normal[0] * q + normal[2];
                along = dot * dot / (length * (1.0f + q * q));
            }
            const VecF half = exp_minus(clamp(0.5f * surfaces.width * (1.0f - along), 0.0f, 4.5f));
            const VecF size = load(surfaces.specular + at) * half * half + load(surfaces.diffuse + at);
            const VecF level = clamp(size * to_units, -32767.0f, 32767.0f);
            const VecI whole = __builtin_convertvector((level + 12582912.0f) - 12582912.0f, VecI);
            std::int32_t rounded[kWidth];
            std::memcpy(rounded, &whole, sizeof whole);
            for (int i = 0; i < std::min<int>(kWidth, to - at); ++i) amplitude[own + i] = static_cast<std::int16_t>(rounded[i]);
        }
    }
}

// --- echoes ---

struct Echoes {
    alignas(64) std::int32_t offset[kWidth];
    alignas(64) float value[2 * kWidth], along[2 * kWidth];  // re, im; shares of the half-sample before and after
    alignas(64) float across[kWidth];                        // share of the next line
    unsigned heard;                                          // a bit each
};

// a0 b0 a1 b1 ...
inline void store_pairs(float *to, VecF a, VecF b) {
#if defined(__AVX512F__)
    store(to, __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23));
    store(to + 16, __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31));
#elif defined(__AVX2__)
    store(to, __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11));
    store(to + 8, __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15));
#else
    store(to, __builtin_shufflevector(a, b, 0, 4, 1, 5));
    store(to + 4, __builtin_shufflevector(a, b, 2, 6, 3, 7));
#endif
}

// How the beams lie within a cell: parallel, fanning out a little, or (near the apex) any way.
enum class Fan { none, narrow, wide };

template <Fan fan>
inline void echoes_of(const BeamGeometry &beam, const CellFrame &frame, const float *c, float cut, const Cells &cells,
                      std::size_t at, int first_line, std::int32_t row, Echoes &out) {
    const VecF step = splat(1.0f / 65536);
    const VecF u = (__builtin_convertvector(load_as<VecU16>(cells.u + at), VecF) + 0.5f) * step;
    const VecF v = (__builtin_convertvector(load_as<VecU16>(cells.v + at), VecF) + 0.5f) * step;
    const VecF w = (__builtin_convertvector(load_as<VecU16>(cells.w + at), VecF) + 0.5f) * step;
    const auto place = [&](int a) {
        return ((c[28 + a] * w + c[16 + a]) * v + (c[20 + a] * w + c[4 + a])) * u +
               ((c[24 + a] * w + c[8 + a]) * v + (c[12 + a] * w + c[a]));
    };
    const VecF elevation = place(1) + frame.elevation;
    out.heard = bits_of(elevation * elevation < cut);
    if (!out.heard) return;  // all beside the slice
    VecF further = place(2), across = place(0);  // than the cell's corner
    if constexpr (fan == Fan::narrow) {
        const VecF q = across * reciprocal(further + frame.reach), squared = q * q;
        further += across * q * horner(squared, kRootNarrow);
        across = q * horner(squared, kAtanNarrow);
    }
    if constexpr (fan == Fan::wide) {
        const VecF q = clamp(across / (further + frame.reach), -1.0f, 1.0f);
        further += across * q / (1.0f + sqrt_of(1.0f + q * q));
        across = q * horner(q * q, kAtan);
    }
    const VecF range = further + frame.range;
    const VecF off_focus = range - beam.focus_mm;
    const VecF inverse = reciprocal(beam.focus_variance + beam.spread_squared * off_focus * off_focus);
    const VecF squared = 0.5f * elevation * elevation * inverse;
    const VecF profile = exp_minus(squared < 4.5f ? squared : splat(4.5f)) - beam.cut_weight;
    VecF amplitude = __builtin_convertvector(load_as<VecI16>(cells.amplitude + at), VecF) * cells.amplitude_step;
    amplitude *= profile;

    VecF cycles = further * beam.cycles_per_mm + frame.cycles;
    cycles -= (cycles + 12582912.0f) - 12582912.0f;  // to the nearest whole number
    const VecF x2 = cycles * cycles;
    store_pairs(out.value, amplitude * horner(x2, kCos), -amplitude * cycles * horner(x2, kSin));

    VecI line, bin;
    const VecF l = clamp(across * beam.lines_per_step + frame.line, -4.0f, static_cast<float>(beam.lines) + 4.0f);
    store(out.across, l - floor_of(l, line));
    const float end = static_cast<float>(2 * beam.samples + kBinPad - 2);
    const VecF b = clamp(range * beam.half_samples_per_mm, static_cast<float>(2 - kBinPad), end);
    const VecF after = b - floor_of(b, bin);
    store_pairs(out.along, 1.0f - after, after);
    line -= first_line - 1;
    const VecI offset = line * row + 2 * (bin + kBinPad);
    std::memcpy(out.offset, &offset, sizeof offset);
    out.heard = bits_of((line >= 0) & (line <= kStripLines) & (profile > 0.0f));
}

// {a, b, a, b} of two floats, and {a, a, b, b}
inline V4 twice(const float *pair) {
    double both;
    std::memcpy(&both, pair, sizeof both);
    typedef double V2 __attribute__((vector_size(16)));
    return (V4)V2{both, both};
}
inline V4 each_twice(const float *pair) {
    const V4 both = twice(pair);
    return __builtin_shufflevector(both, both, 0, 0, 1, 1);
}

template <Fan fan>
void splat_cell(const BeamGeometry &beam, const Cells &cells, std::size_t cell, const float *c, int first_line,
                float *strip, std::size_t row) {
    Echoes echoes;
    const float cut = widest_cut(beam, cells.frames[cell], c);
    const std::size_t end = static_cast<std::size_t>(cells.starts[cell + 1]);
    for (std::size_t at = static_cast<std::size_t>(cells.starts[cell]); at < end; at += kWidth) {
        echoes_of<fan>(beam, cells.frames[cell], c, cut, cells, at, first_line, static_cast<std::int32_t>(row), echoes);
        if (end - at < kWidth) echoes.heard &= (1u << (end - at)) - 1;
        for (unsigned left = echoes.heard; left; left &= left - 1) {
            const int i = __builtin_ctz(left);
            const V4 value = twice(echoes.value + 2 * i) * each_twice(echoes.along + 2 * i);
            const V4 right = value * echoes.across[i];
            float *near = strip + echoes.offset[i], *next = near + row;
            store4(near, load4(near) + (value - right));
            store4(next, load4(next) + right);
        }
    }
}

void splat(const BeamGeometry &beam, const Cells &cells, const float *polynomials, const LineSpan *spans,
           int first_line, float *strip, std::size_t row) {
    const int from = first_line - 1, to = first_line + kStripLines - 1;
    for (std::size_t cell = 0; cell < cells.count; ++cell) {
        if (spans[cell].last < from || spans[cell].first > to || spans[cell].last < spans[cell].first) continue;
        const float *c = polynomials + kPolynomialFloats * cell;
        const auto add = !beam.curved  ? splat_cell<Fan::none>
                         : c[3] != 0.0f ? splat_cell<Fan::narrow>
                                        : splat_cell<Fan::wide>;
        add(beam, cells, cell, c, first_line, strip, row);
    }
}

}  // namespace

extern const EchoKernels echo_kernels;
const EchoKernels echo_kernels = {place, reflect, splat};

}  // namespace SONO_ISA
}  // namespace sono

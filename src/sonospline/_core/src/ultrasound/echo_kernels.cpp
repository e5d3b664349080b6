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

inline VecF in_cell(const std::uint16_t *place) { return load_u16(place) * (1.0f / 65536) + 0.5f / 65536; }

// Squared elevation beyond which nothing in a cell is heard.
float widest_cut(const BeamGeometry &beam, const CellFrame &frame, const float *c) {
    V4 sizes = {};
    for (int k = 0; k < 8; ++k) {
        const V4 v = load4(c + 4 * k);
        sizes += v < 0.0f ? -v : v;
    }
    const float reach = std::fabs(frame.range - beam.focus_mm) + (sizes[0] + sizes[2]);
    return beam.cut_squared * (beam.focus_variance + beam.spread_squared * reach * reach);
}

void reflect(const BeamGeometry &beam, const Cells &cells, const Surfaces &surfaces, const float *polynomials,
             const LineSpan *spans, std::size_t first, std::size_t last, std::int16_t *__restrict amplitude) {
    const float to_units = 1 / cells.amplitude_step;
    for (std::size_t cell = first; cell < last; ++cell) {
        const std::int32_t from = surfaces.starts[cell], to = surfaces.starts[cell + 1];
        if (from == to || spans[cell].last < spans[cell].first) continue;
        const float *c = polynomials + kPolynomialFloats * cell;
        const std::int32_t scatterer = cells.starts[cell + 1] - (to - from);
        const float cut = widest_cut(beam, cells.frames[cell], c);
        for (std::int32_t at = from; at < to; at += kWidth) {
            const std::int32_t own = scatterer + at - from;
            const VecF u = in_cell(cells.u + own);
            const VecF v = in_cell(cells.v + own);
            const VecF w = in_cell(cells.w + own);
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
            const VecI16 rounded = __builtin_convertvector(whole, VecI16);
            std::memcpy(amplitude + own, &rounded, std::min<std::size_t>(kWidth, to - at) * sizeof *amplitude);
        }
    }
}

// --- echoes ---

// Scatterers that are heard, side by side whichever cell they are of: every lane of what follows counts.
struct Heard {
    static constexpr int kEnough = 128, kMost = 2 * kEnough + kWidth;
    alignas(64) float elevation[kMost] = {}, range[kMost] = {}, cycles[kMost] = {}, line[kMost] = {}, amplitude[kMost] = {};
    int count = 0;
};

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

// How the beams lie within a cell: parallel, fanning out a little, or (near the apex) any way.
enum class Fan { none, narrow, wide };

constexpr int kSoon = 64;  // scatterers further, to be fetched from memory

// Hears scatterers [at, end) of a cell, at most kEnough. Copies, since a compiler cannot know what `heard` overlaps.
template <Fan fan>
void hear(const BeamGeometry &beam, const Cells &cells, const CellFrame &frame, const float *c, float cut, std::int32_t at,
          std::int32_t end, int first_line, int lines, Heard &__restrict heard) {
    int count = heard.count;
    for (; at < end; at += kWidth) {
        for (const std::uint16_t *soon : {cells.u, cells.v, cells.w}) __builtin_prefetch(soon + at + kSoon);
        __builtin_prefetch(cells.amplitude + at + kSoon);
        const VecF u = in_cell(cells.u + at), v = in_cell(cells.v + at), w = in_cell(cells.w + at);
        const auto place = [&](int a) {
            return ((c[28 + a] * w + c[16 + a]) * v + (c[20 + a] * w + c[4 + a])) * u +
                   ((c[24 + a] * w + c[8 + a]) * v + (c[12 + a] * w + c[a]));
        };
        const VecF elevation = place(1) + frame.elevation;
        const VecI within = elevation * elevation < cut;
        if (!bits_of(within)) continue;  // all beside the slice
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
        VecI whole;
        const VecF line = clamp(across * beam.lines_per_step + frame.line, -4.0f, static_cast<float>(beam.lines) + 4.0f);
        floor_of(line, whole);
        whole -= first_line - 1;
        unsigned lanes = bits_of(within & (whole >= 0) & (whole <= lines));
        if (end - at < kWidth) lanes &= (1u << (end - at)) - 1;
        const Packed packed(lanes);
        packed.store(heard.elevation + count, elevation);
        packed.store(heard.range + count, further + frame.range);
        packed.store(heard.cycles + count, further * beam.cycles_per_mm + frame.cycles);
        packed.store(heard.line + count, line);
        packed.store(heard.amplitude + count, load_i16(cells.amplitude + at) * cells.amplitude_step);
        count += __builtin_popcount(lanes);
    }
    heard.count = count;
}

// Adds what was heard to a strip.
void add(const BeamGeometry &beam, Heard &heard, int first_line, float *strip, std::size_t row) {
    const float end = static_cast<float>(2 * beam.samples + kBinPad - 2);
    alignas(64) std::int32_t offset[kWidth];
    alignas(64) float value[2 * kWidth], along[2 * kWidth];  // re, im; shares of the half-sample before and after
    alignas(64) float across[kWidth];                        // share of the next line
    for (int at = 0; at < heard.count; at += kWidth) {
        const VecF elevation = load(heard.elevation + at), range = load(heard.range + at);
        const VecF off_focus = range - beam.focus_mm;
        const VecF inverse = reciprocal(beam.focus_variance + beam.spread_squared * off_focus * off_focus);
        const VecF squared = 0.5f * elevation * elevation * inverse;
        const VecF profile = exp_minus(squared < 4.5f ? squared : splat(4.5f)) - beam.cut_weight;
        const VecF amplitude = load(heard.amplitude + at) * profile;

        VecF cycles = load(heard.cycles + at);
        cycles -= (cycles + 12582912.0f) - 12582912.0f;  // to the nearest whole number
        const VecF x2 = cycles * cycles;
        const VecF re = amplitude * horner(x2, kCos), im = -amplitude * cycles * horner(x2, kSin);
        const VecI inside = profile > 0.0f;
        store_pairs(value, inside ? re : VecF{}, inside ? im : VecF{});

        VecI line, bin;
        const VecF l = load(heard.line + at);
        store(across, l - floor_of(l, line));
        const VecF b = clamp(range * beam.half_samples_per_mm, static_cast<float>(2 - kBinPad), end);
        const VecF after = b - floor_of(b, bin);
        store_pairs(along, 1.0f - after, after);
        const VecI where = (line - (first_line - 1)) * static_cast<std::int32_t>(row) + 2 * (bin + kBinPad);
        std::memcpy(offset, &where, sizeof where);

        const int lanes = std::min(kWidth, heard.count - at);
        for (int i = 0; i < lanes; ++i) {
            const V4 both = twice(value + 2 * i) * each_twice(along + 2 * i);
            const V4 right = both * across[i];
            float *near = strip + offset[i], *next = near + row;
            store4(near, load4(near) + (both - right));
            store4(next, load4(next) + right);
        }
    }
    heard.count = 0;
}

void splat(const BeamGeometry &beam, const Cells &cells, const std::int32_t *surface_starts, const std::int16_t *turned,
           const float *polynomials, const LineSpan *spans, int first_line, int lines, float *strip, std::size_t row) {
    const int from = first_line - 1, to = first_line + lines - 1;
    Cells turning = cells;
    turning.amplitude = turned;
    Heard heard;
    for (std::size_t cell = 0; cell < cells.count; ++cell) {
        if (spans[cell].last < from || spans[cell].first > to || spans[cell].last < spans[cell].first) continue;
        const float *c = polynomials + kPolynomialFloats * cell;
        const auto hear_some = !beam.curved ? hear<Fan::none> : c[3] != 0.0f ? hear<Fan::narrow> : hear<Fan::wide>;
        const float cut = widest_cut(beam, cells.frames[cell], c);
        const auto hear_from = [&](const Cells &from, std::int32_t first, std::int32_t end) {
            for (; first < end; first += Heard::kEnough) {
                hear_some(beam, from, cells.frames[cell], c, cut, first, std::min(end, first + Heard::kEnough), first_line, lines, heard);
                if (heard.count >= Heard::kEnough) add(beam, heard, first_line, strip, row);
            }
        };
        const std::int32_t end = cells.starts[cell + 1], on = end - (surface_starts[cell + 1] - surface_starts[cell]);
        hear_from(cells, cells.starts[cell], on);
        hear_from(turning, on, end);
    }
    add(beam, heard, first_line, strip, row);
}

}  // namespace

extern const EchoKernels echo_kernels;
const EchoKernels echo_kernels = {place, reflect, splat};

}  // namespace SONO_ISA
}  // namespace sono

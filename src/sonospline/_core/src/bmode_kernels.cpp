// Compiled once per instruction set (SONO_ISA names it), like kernels.cpp.
#include "bmode_kernels.hpp"

#include <algorithm>
#include <cmath>

#include "vec.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

constexpr int kWidth = lanes<float>;

typedef float V4 __attribute__((vector_size(16)));
typedef std::int32_t VecI __attribute__((vector_size(kBytes)));
typedef std::uint16_t VecU16 __attribute__((vector_size(kBytes / 2)));
typedef std::int16_t VecI16 __attribute__((vector_size(kBytes / 2)));
typedef std::uint8_t VecU8 __attribute__((vector_size(kBytes / 4)));

template <class V> inline V load_as(const void *from) {
    V v;
    std::memcpy(&v, from, sizeof v);
    return v;
}
inline V4 load4(const float *from) { return load_as<V4>(from); }
inline void store4(float *to, V4 v) { std::memcpy(to, &v, sizeof v); }

inline VecF clamp(VecF x, float low, float high) {
    x = x > low ? x : splat(low);
    return x < high ? x : splat(high);
}
inline VecF floor_of(VecF x, VecI &whole) {
    whole = __builtin_convertvector(x, VecI);
    VecF f = __builtin_convertvector(whole, VecF);
    const VecI above = f > x;
    whole += above;
    return __builtin_convertvector(whole, VecF);
}

template <int N> inline VecF horner(VecF x, const float (&c)[N]) {
    VecF sum = splat(c[N - 1]);
    for (int i = N - 2; i >= 0; --i) sum = sum * x + c[i];
    return sum;
}

// Chebyshev fits: sin and cos of 2 pi x for |x| <= 1/2 (1e-8), atan(x) / x for |x| <= 1 (2e-8),
// exp(-x/8) for x <= 4.5 (3e-10), log2(1 + m) / m for 0 <= m <= 1 (3e-7)
constexpr float kSin[] = {6.2831853f, -41.3417004f, 81.6051314f, -76.7030154f, 42.025927f, -14.8998467f, 3.23813751f};
constexpr float kCos[] = {0.999999989f, -19.7392045f, 64.9391175f, -85.4501395f, 60.167631f, -25.9675992f, 6.52865816f};
constexpr float kAtan[] = {0.999999984f, -0.333330668f, 0.199924836f,  -0.142025705f,  0.106367541f,
                           -0.0749544544f, 0.0425876075f, -0.0160050305f, 0.0028340643f};
constexpr float kExp[] = {1.0f, -0.124999993f, 0.00781247393f, -0.000325485719f, 1.01498857e-05f, -2.46742282e-07f,
                          4.01059632e-09f};
constexpr float kLog[] = {1.44269477f, -0.721310723f, 0.480073748f, -0.35345468f,
                          0.256179696f, -0.155599957f, 0.063787589f, -0.012370641f};

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
        }
        const float from = frame.line + left * beam.lines_per_step - 1, to = frame.line + right * beam.lines_per_step + 1;
        if (to < -1 || from > static_cast<float>(beam.lines)) continue;
        spans[cell] = {static_cast<std::int16_t>(std::max(from, -1.0f)),
                       static_cast<std::int16_t>(std::min(to, static_cast<float>(beam.lines)))};
    }
}

// --- echoes ---

struct Echoes {
    alignas(64) std::int32_t offset[kWidth];
    alignas(64) float re[kWidth], im[kWidth], line[kWidth], bin[kWidth];
};

template <bool Curved>
inline void echoes_of(const BeamGeometry &beam, const CellFrame &frame, const float *c, const Cells &cells,
                      std::size_t at, int first_line, std::int32_t row, Echoes &out) {
    const VecF step = splat(1.0f / 65536);
    const VecF u = (__builtin_convertvector(load_as<VecU16>(cells.u + at), VecF) + 0.5f) * step;
    const VecF v = (__builtin_convertvector(load_as<VecU16>(cells.v + at), VecF) + 0.5f) * step;
    const VecF w = (__builtin_convertvector(load_as<VecU16>(cells.w + at), VecF) + 0.5f) * step;
    VecF place[3];
    for (int a = 0; a < 3; ++a)
        place[a] = ((c[28 + a] * w + c[16 + a]) * v + (c[20 + a] * w + c[4 + a])) * u +
                   ((c[24 + a] * w + c[8 + a]) * v + (c[12 + a] * w + c[a]));
    VecF further = place[2], across = place[0];  // than the cell's corner
    if constexpr (Curved) {
        const VecF q = clamp(across / (further + frame.reach), -1.0f, 1.0f);
        further += across * q / (1.0f + sqrt_of(1.0f + q * q));
        across = q * horner(q * q, kAtan);
    }
    const VecF range = further + frame.range;
    const VecF elevation = place[1] + frame.elevation, off_focus = range - beam.focus_mm;
    const VecF squared = elevation * elevation / (beam.focus_variance + beam.spread_squared * off_focus * off_focus);
    const VecF profile = exp_minus(clamp(0.5f * squared, 0.0f, 4.5f)) - beam.cut_weight;
    VecF amplitude = __builtin_convertvector(load_as<VecI16>(cells.amplitude + at), VecF) * cells.amplitude_step;
    amplitude *= profile > 0.0f ? profile : splat(0.0f);

    VecF cycles = further * beam.cycles_per_mm + frame.cycles;
    cycles -= (cycles + 12582912.0f) - 12582912.0f;  // to the nearest whole number
    const VecF x2 = cycles * cycles;
    store(out.re, amplitude * horner(x2, kCos));
    store(out.im, -amplitude * cycles * horner(x2, kSin));

    VecI line, bin;
    const VecF l = clamp(across * beam.lines_per_step + frame.line, -4.0f, static_cast<float>(beam.lines) + 4.0f);
    store(out.line, l - floor_of(l, line));
    const float end = static_cast<float>(2 * beam.samples + kBinPad - 2);
    const VecF b = clamp(range * beam.half_samples_per_mm, static_cast<float>(2 - kBinPad), end);
    store(out.bin, b - floor_of(b, bin));
    line -= first_line - 1;
    const VecI here = (line >= 0) & (line <= kStripLines);
    const VecI offset = here ? line * row + 2 * (bin + kBinPad) : VecI{} + (kStripLines + 2) * row;
    std::memcpy(out.offset, &offset, sizeof offset);
}

template <bool Curved>
void splat_beams(const BeamGeometry &beam, const Cells &cells, const float *polynomials, const LineSpan *spans,
                 int first_line, float *strip, std::size_t row) {
    const int from = first_line - 1, to = first_line + kStripLines - 1;
    Echoes echoes;
    for (std::size_t cell = 0; cell < cells.count; ++cell) {
        if (spans[cell].last < from || spans[cell].first > to || spans[cell].last < spans[cell].first) continue;
        const float *c = polynomials + kPolynomialFloats * cell;
        const std::size_t end = static_cast<std::size_t>(cells.starts[cell + 1]);
        for (std::size_t at = static_cast<std::size_t>(cells.starts[cell]); at < end; at += kWidth) {
            echoes_of<Curved>(beam, cells.frames[cell], c, cells, at, first_line, static_cast<std::int32_t>(row), echoes);
            const int count = static_cast<int>(std::min<std::size_t>(kWidth, end - at));
            for (int i = 0; i < count; ++i) {
                const float re = echoes.re[i], im = echoes.im[i], f = echoes.bin[i], g = echoes.line[i];
                const V4 value = V4{re, im, re, im} * V4{1 - f, 1 - f, f, f};
                const V4 right = value * g;
                float *near = strip + echoes.offset[i], *next = near + row;
                store4(near, load4(near) + (value - right));
                store4(next, load4(next) + right);
            }
        }
    }
}

void splat(const BeamGeometry &beam, const Cells &cells, const float *polynomials, const LineSpan *spans,
           int first_line, float *strip, std::size_t row) {
    (beam.curved ? splat_beams<true> : splat_beams<false>)(beam, cells, polynomials, spans, first_line, strip, row);
}

// --- convolutions ---

void axial(int half, const float *taps, const float *in, std::size_t samples, const float *gain, float *scratch,
           float *out) {
    // even and odd half-samples apart, so that each tap meets contiguous samples
    const std::size_t each = samples + kBinPad;
    float *even = scratch, *odd = scratch + 2 * each;
    for (std::size_t i = 0; i < each; ++i) {
        std::memcpy(even + 2 * i, in + 4 * i, 8);
        std::memcpy(odd + 2 * i, in + 4 * i + 2, 8);
    }
    for (std::size_t at = 0; at < 2 * samples; at += kWidth) {
        VecF sum = {};
        for (int k = -half; k <= half; ++k) {
            const std::ptrdiff_t whole = (k + kBinPad) / 2;
            sum += taps[k + half] * load((k & 1 ? odd : even) + at + 2 * whole);
        }
        store(out + at, sum);
    }
    for (std::size_t i = 0; i < samples; ++i) out[2 * i] *= gain[i], out[2 * i + 1] *= gain[i];
}

void lateral(int count, const float *const *taps, const float *const *lines, std::size_t samples, const float *noise,
             float noise_level, float *out) {
    for (std::size_t at = 0; at < 2 * samples; at += kWidth) {
        VecF sum = noise_level * load(noise + at);
        for (int k = 0; k < count; ++k)
            if (lines[k]) sum += load(taps[k] + at) * load(lines[k] + at);
        store(out + at, sum);
    }
}

// --- grey levels ---

void compress(const float *in, const float *offset_db, float range_db, std::size_t samples, float *power,
              std::uint8_t *grey) {
    for (std::size_t i = 0; i < samples; ++i) power[i] = in[2 * i] * in[2 * i] + in[2 * i + 1] * in[2 * i + 1];
    constexpr float db_per_octave = 3.01029996f;
    const float scale = 255 / range_db;
    for (std::size_t i = 0; i < samples; i += kWidth) {
        const VecF x = load(power + i) + 1e-30f;
        VecI bits;
        std::memcpy(&bits, &x, sizeof bits);
        const VecF exponent = __builtin_convertvector((bits >> 23) - 127, VecF);
        bits = (bits & 0x7fffff) | 0x3f800000;
        VecF m;
        std::memcpy(&m, &bits, sizeof m);
        m -= 1.0f;
        const VecF db = db_per_octave * (exponent + m * horner(m, kLog)) + load(offset_db + i);
        const VecF level = clamp((db + range_db) * scale, 0.0f, 255.0f) + 0.5f;
        const VecU8 bytes = __builtin_convertvector(__builtin_convertvector(level, VecI), VecU8);
        std::memcpy(grey + i, &bytes, sizeof bytes);
    }
}

}  // namespace

extern const BmodeKernels bmode_kernels;
const BmodeKernels bmode_kernels = {place, splat, axial, lateral, compress};

}  // namespace SONO_ISA
}  // namespace sono

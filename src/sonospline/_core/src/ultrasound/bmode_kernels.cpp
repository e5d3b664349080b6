// Compiled once per instruction set (SONO_ISA names it), like common/kernels.cpp: from echoes to grey pixels.
#include <algorithm>
#include <cmath>

#include "ultrasound/bmode_kernels.hpp"
#include "ultrasound/float_vectors.hpp"

namespace sono {
namespace SONO_ISA {
namespace {

// Chebyshev fits: log2(1 + m) / m for 0 <= m <= 1 (3e-7), 2^x for 0 <= x <= 1 (6e-8)
constexpr float kLog[] = {1.44269477f, -0.721310723f, 0.480073748f, -0.35345468f,
                          0.256179696f, -0.155599957f, 0.063787589f, -0.012370641f};
constexpr float kExp2[] = {1.0f, 0.693146944f, 0.240230501f, 0.055480428f, 0.00968458038f, 0.00123878219f, 0.000218775051f};

// --- convolutions ---

constexpr int kRun = kLateralRun / kWidth;  // vectors at once: a sum's additions wait for one another

// Vectors of pairs (re, im) at even and at odd half-samples.
inline void split_pairs(const float *in, VecF &even, VecF &odd) {
    const VecF a = load(in), b = load(in + kWidth);
#if defined(__AVX512F__)
    even = __builtin_shufflevector(a, b, 0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29);
    odd = __builtin_shufflevector(a, b, 2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23, 26, 27, 30, 31);
#elif defined(__AVX2__)
    even = __builtin_shufflevector(a, b, 0, 1, 4, 5, 8, 9, 12, 13);
    odd = __builtin_shufflevector(a, b, 2, 3, 6, 7, 10, 11, 14, 15);
#else
    even = __builtin_shufflevector(a, b, 0, 1, 4, 5);
    odd = __builtin_shufflevector(a, b, 2, 3, 6, 7);
#endif
}

void axial(int half, const float *taps, const float *in, std::size_t samples, const float *gain, float *scratch,
           float *out) {
    // even and odd half-samples apart, so that each tap meets contiguous samples
    const std::size_t each = samples + kBinPad;
    float *even = scratch, *odd = scratch + 2 * each;
    for (std::size_t i = 0; i < 2 * each; i += kWidth) {
        VecF a, b;
        split_pairs(in + 2 * i, a, b);
        store(even + i, a), store(odd + i, b);
    }
    const float *of[2] = {(half & 1 ? odd : even) + 2 * kBinPad / 2, (half & 1 ? even : odd) + 2 * kBinPad / 2};
    for (std::size_t at = 0; at < 2 * samples; at += kRun * kWidth) {
        VecF sum[kRun] = {}, other[kRun] = {};  // of the first tap's half-samples, and of those between
        const auto add = [&](VecF *to, const float *in, int k) {
            const std::ptrdiff_t whole = k >= 0 ? k / 2 : -((1 - k) / 2);
            for (int i = 0; i < kRun; ++i) to[i] += taps[k + half] * load(in + at + 2 * whole + i * kWidth);
        };
        for (int k = -half; k < half; k += 2) add(sum, of[0], k), add(other, of[1], k + 1);
        add(sum, of[0], half);
        for (int i = 0; i < kRun; ++i) {
            const std::size_t to = at + static_cast<std::size_t>(i) * kWidth;
            store(out + to, (sum[i] + other[i]) * load(gain + to));
        }
    }
}

void lateral(int below, int above, const float *taps, const float *line, std::ptrdiff_t stride, std::size_t from,
             std::size_t end, const int *reach, const float *noise, float noise_level, float *out) {
    for (std::size_t at = from; at < end; at += kRun * kWidth) {
        VecF sum[kRun];
        for (int i = 0; i < kRun; ++i) sum[i] = noise_level * load(noise + at + static_cast<std::size_t>(i) * kWidth);
        const int wide = reach[at / kLateralRun];
        for (int k = -std::min(below, wide); k <= std::min(above, wide); ++k) {
            const float *tap = taps + k * stride + at, *beside = line + k * stride + at;
            for (int i = 0; i < kRun; ++i) sum[i] += load(tap + i * kWidth) * load(beside + i * kWidth);
        }
        for (int i = 0; i < kRun; ++i) store(out + at + static_cast<std::size_t>(i) * kWidth, sum[i]);
    }
}

// --- what fills the black ---

void widen(const float *low, const float *high, float of_high, const float *scale, std::size_t samples, float *out) {
    for (std::size_t n = 0; n < samples; n += kWidth) {
        float scales[2 * kWidth];
        store_pairs(scales, load(scale + n), load(scale + n));
        for (std::size_t i = 0; i < 2 * kWidth; i += kWidth) {
            const std::size_t k = 2 * n + i;
            store(out + k, load(out + k) + load(scales + i) * (load(low + k) + of_high * (load(high + k) - load(low + k))));
        }
    }
}

inline float sum_of(VecF v) {
    float sum = 0;
    for (int i = 0; i < kWidth; ++i) sum += v[i];
    return sum;
}

void tail(const float *texture, float level, float keep, const float *more, std::size_t samples, float *out) {
    float fed = 0, from = 0;
    VecF ramp[2 * kTailRun / kWidth];  // twice 0, 1, 2 ...
    for (int k = 0; k < 2 * kTailRun; ++k) ramp[k / kWidth][k % kWidth] = static_cast<float>(k / 2);
    for (std::size_t run = 0; run < samples; run += kTailRun) {
        float *s = out + 2 * run;
        VecF power = {};
        for (int k = 0; k < 2 * kTailRun; k += kWidth) power += load(s + k) * load(s + k);
        fed = keep * fed + sum_of(power) / kTailRun;
        const float to = std::sqrt(level * fed + (more ? more[run / kTailRun] : 0)), slope = (to - from) / kTailRun;
        for (int k = 0; k < 2 * kTailRun; k += kWidth)
            store(s + k, load(s + k) + (slope * ramp[k / kWidth] + from) * load(texture + 2 * run + k));
        from = to;
    }
}

// Where a run's largest echo is, and how far over what is strong.
struct Peak {
    std::size_t at;
    float over;
};

Peak largest(const float *s, const float *loudness, std::size_t first) {
    VecF most = {};
    for (std::size_t k = 2 * first; k < 2 * (first + kTailRun); k += kWidth) {
        const VecF size = load(s + k) * load(s + k);
        most = size > most ? size : most;
    }
    float bound = 0;
    for (int i = 0; i < kWidth; ++i) bound = std::max(bound, most[i]);
    Peak found{first, 0};
    if (2 * bound * std::max(loudness[first], loudness[first + kTailRun - 1]) <= 1) return found;  // no strong one
    for (std::size_t n = first; n < first + kTailRun; ++n) {
        const float over = (s[2 * n] * s[2 * n] + s[2 * n + 1] * s[2 * n + 1]) * loudness[n];
        if (over > found.over) found = {n, over};
    }
    return found;
}

void repeat(const float *unit, const float *loudness, float again, std::size_t samples, float *s) {
    struct { std::size_t at; float re, im; } heard[kMostRepeats];
    Peak before{0, 0}, here{0, 0};
    int count = 0;
    // what lies beyond half of the samples comes again beyond all of them
    for (std::size_t run = kTailRun; run < samples / 2 + kTailRun && count < kMostRepeats; run += kTailRun) {
        const Peak next = run < samples ? largest(s, loudness, run) : Peak{run, 0};
        if (here.over > 1 && here.over >= before.over && here.over > next.over) {
            const float size = again / unit[here.at] * std::min(1.0f, (here.over - 1) / 3);  // fades in
            heard[count++] = {here.at, size * s[2 * here.at], size * s[2 * here.at + 1]};
        }
        before = here, here = next;
    }
    for (int k = 0; k < count; ++k)
        for (std::size_t n = heard[k].at, to = 2 * n; to < samples; ++n, ++to) {  // also of what was added: every multiple
            const float share = unit[to] / unit[n], re = s[2 * n], im = s[2 * n + 1];
            s[2 * to] += share * (heard[k].re * re - heard[k].im * im);
            s[2 * to + 1] += share * (heard[k].re * im + heard[k].im * re);
        }
}

// --- what is lost on the way ---

void transmit(const float *loss_db, std::size_t count, float *left) {
    for (std::size_t i = 0; i < count; i += kWidth) {
        VecI whole;
        const VecF octaves = clamp(load(loss_db + i) * -0.166096404744f, -120.0f, 120.0f);
        const VecF power = horner(octaves - floor_of(octaves, whole), kExp2);
        VecI bits;
        std::memcpy(&bits, &power, sizeof bits);
        bits += whole << 23;
        std::memcpy(left + i, &bits, sizeof bits);
    }
}

void gain(int count, const float *weights, const float *rays, std::size_t ray_samples, const std::int32_t *before,
          const float *beyond, std::size_t samples, float *scratch, float *out) {
    for (std::size_t n = 0; n < ray_samples; n += kWidth) {
        VecF sum = {};
        for (int k = 0; k < count; ++k) sum += weights[k] * load(rays + static_cast<std::size_t>(k) * ray_samples + n);
        store(scratch + n, sum);
    }
    scratch[ray_samples] = scratch[ray_samples - 1];
    for (std::size_t n = 0; n < samples; ++n) {
        const float low = scratch[before[n]], high = scratch[before[n] + 1];
        out[2 * n] = out[2 * n + 1] = low + beyond[n] * (high - low);
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
        store_bytes(grey + i, __builtin_convertvector(level, VecI));
    }
}

// --- scan conversion ---

inline int mixed(const std::uint8_t *at, std::size_t samples, int across, int along) {
    const std::uint8_t *next = at + samples;
    const int here = 256 * at[0] + along * (at[1] - at[0]), beside = 256 * next[0] + along * (next[1] - next[0]);
    return (256 * here + across * (beside - here) + 32768) >> 16;
}

void picture(const std::uint8_t *grey, std::size_t samples, const std::int32_t *pixel, const std::uint8_t *fraction,
             std::size_t columns, std::uint8_t *to) {
    std::size_t c = 0;
#if defined(__AVX2__)
    for (; c + kWidth <= columns; c += kWidth) {
        const VecI at = load_as<VecI>(pixel + c), seen = at >= 0, index = at & seen;
        if (!bits_of(seen)) {
            std::memset(to + c, 0, kWidth);
            continue;
        }
        // four bytes a pixel; on the next line two earlier, since nothing may be read past the last line
        const std::uint8_t *next = grey + samples - 2;
#if defined(__AVX512F__)
        const VecI a = (VecI)_mm512_i32gather_epi32((__m512i)index, grey, 1);
        const VecI b = (VecI)_mm512_i32gather_epi32((__m512i)index, next, 1);
#else
        const VecI a = (VecI)_mm256_i32gather_epi32(reinterpret_cast<const int *>(grey), (__m256i)index, 1);
        const VecI b = (VecI)_mm256_i32gather_epi32(reinterpret_cast<const int *>(next), (__m256i)index, 1);
#endif
        const VecI shares = __builtin_convertvector(load_as<VecU16>(fraction + 2 * c), VecI);
        const VecI across = shares & 255, along = shares >> 8;
        const VecI a0 = a & 255, a1 = (a >> 8) & 255, b0 = (b >> 16) & 255, b1 = (b >> 24) & 255;
        const VecI here = 256 * a0 + along * (a1 - a0), beside = 256 * b0 + along * (b1 - b0);
        store_bytes(to + c, ((256 * here + across * (beside - here) + 32768) >> 16) & seen);
    }
#endif
    for (; c < columns; ++c)
        to[c] = pixel[c] < 0 ? std::uint8_t{0}
                             : static_cast<std::uint8_t>(mixed(grey + pixel[c], samples, fraction[2 * c], fraction[2 * c + 1]));
}

}  // namespace

extern const BmodeKernels bmode_kernels;
const BmodeKernels bmode_kernels = {axial, lateral, widen, tail, repeat, transmit, gain, compress, picture};

}  // namespace SONO_ISA
}  // namespace sono

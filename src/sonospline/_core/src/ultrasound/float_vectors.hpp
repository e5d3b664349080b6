// More of the vectors of vec.hpp: other element types, and functions of float vectors.
#pragma once

#include <cstdint>

#include "common/vec.hpp"

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

// Compilers lower none of these to the one or two instructions there are.
inline VecF clamp(VecF x, float low, float high) {  // NaN goes to low
#if defined(__AVX512F__)
    return (VecF)_mm512_min_ps(_mm512_max_ps((__m512)x, (__m512)splat(low)), (__m512)splat(high));
#elif defined(__AVX2__)
    return (VecF)_mm256_min_ps(_mm256_max_ps((__m256)x, (__m256)splat(low)), (__m256)splat(high));
#elif defined(__SSE2__)
    return (VecF)_mm_min_ps(_mm_max_ps((__m128)x, (__m128)splat(low)), (__m128)splat(high));
#else
    x = x > low ? x : splat(low);
    return x < high ? x : splat(high);
#endif
}
inline VecF floor_of(VecF x, VecI &whole) {
#if defined(__AVX512F__)
    const VecF f = (VecF)_mm512_roundscale_ps((__m512)x, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
#elif defined(__AVX2__)
    const VecF f = (VecF)_mm256_floor_ps((__m256)x);
#else
    whole = __builtin_convertvector(x, VecI);
    VecF f = __builtin_convertvector(whole, VecF);
    const VecI above = f > x;
    whole += above;
    return __builtin_convertvector(whole, VecF);
#endif
#if defined(__AVX2__)
    whole = __builtin_convertvector(f, VecI);
    return f;
#endif
}
inline VecF load_u16(const std::uint16_t *from) {
#if defined(__AVX512F__)
    return (VecF)_mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(load_as<__m256i>(from)));
#elif defined(__AVX2__)
    return (VecF)_mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(load_as<__m128i>(from)));
#else
    return __builtin_convertvector(load_as<VecU16>(from), VecF);
#endif
}
inline VecF load_i16(const std::int16_t *from) {
#if defined(__AVX512F__)
    return (VecF)_mm512_cvtepi32_ps(_mm512_cvtepi16_epi32(load_as<__m256i>(from)));
#elif defined(__AVX2__)
    return (VecF)_mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(load_as<__m128i>(from)));
#else
    return __builtin_convertvector(load_as<VecI16>(from), VecF);
#endif
}

template <int N> inline VecF horner(VecF x, const float (&c)[N]) {
    VecF sum = splat(c[N - 1]);
    for (int i = N - 2; i >= 0; --i) sum = sum * x + c[i];
    return sum;
}

// A bit for each lane that is -1.
inline unsigned bits_of(VecI mask) {
#if defined(__AVX512DQ__)
    return _mm512_movepi32_mask((__m512i)mask);
#elif defined(__AVX2__)
    return static_cast<unsigned>(_mm256_movemask_ps((__m256)mask));
#elif defined(__SSE2__)
    return static_cast<unsigned>(_mm_movemask_ps((__m128)mask));
#else
    unsigned bits = 0;
    for (int i = 0; i < kWidth; ++i) bits |= static_cast<unsigned>(mask[i] & 1) << i;
    return bits;
#endif
}

inline void store_bytes(std::uint8_t *to, VecI v) {  // of 0 to 255
#if defined(__AVX512F__)
    const __m128i bytes = _mm512_cvtepi32_epi8((__m512i)v);
#elif defined(__AVX2__)
    const __m128i words = _mm_packus_epi32(_mm256_castsi256_si128((__m256i)v), _mm256_extracti128_si256((__m256i)v, 1));
    const __m128i bytes = _mm_packus_epi16(words, words);
#elif defined(__SSE2__)
    const __m128i words = _mm_packs_epi32((__m128i)v, (__m128i)v), bytes = _mm_packus_epi16(words, words);
#else
    const VecU8 bytes = __builtin_convertvector(v, VecU8);
#endif
    std::memcpy(to, &bytes, kWidth);
}

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

// Some lanes of a vector, side by side; what is stored behind them means nothing.
class Packed {
  public:
    explicit Packed(unsigned lanes);
    void store(float *to, VecF v) const;

#if defined(__AVX512F__)
  private:
    __mmask16 lanes_;
};
inline Packed::Packed(unsigned lanes) : lanes_(static_cast<__mmask16>(lanes)) {}
inline void Packed::store(float *to, VecF v) const { _mm512_storeu_ps(to, _mm512_maskz_compress_ps(lanes_, (__m512)v)); }
#elif defined(__AVX2__)
  private:
    __m256i order_;
};
struct Orders {
    std::uint8_t lanes[256][8] = {};
    constexpr Orders() {
        for (int set = 0; set < 256; ++set)
            for (int lane = 0, n = 0; lane < 8; ++lane)
                if (set >> lane & 1) lanes[set][n++] = static_cast<std::uint8_t>(lane);
    }
};
constexpr Orders kOrders;
inline Packed::Packed(unsigned lanes)
    : order_(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i *>(kOrders.lanes[lanes])))) {}
inline void Packed::store(float *to, VecF v) const { sono::SONO_ISA::store(to, (VecF)_mm256_permutevar8x32_ps((__m256)v, order_)); }
#else
  private:
    unsigned lanes_;
};
inline Packed::Packed(unsigned lanes) : lanes_(lanes) {}
inline void Packed::store(float *to, VecF v) const {
    for (int lane = 0; lane < kWidth; ++lane) {
        *to = v[lane];
        to += lanes_ >> lane & 1;
    }
}
#endif

}  // namespace
}  // namespace SONO_ISA
}  // namespace sono

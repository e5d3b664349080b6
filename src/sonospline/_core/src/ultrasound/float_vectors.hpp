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

}  // namespace
}  // namespace SONO_ISA
}  // namespace sono

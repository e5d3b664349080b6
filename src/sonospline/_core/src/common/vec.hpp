// SIMD vectors of this translation unit's instruction set (GCC/Clang vector
// extensions), with the one operation that differs between sets: 1/sqrt.
#pragma once

#include <cstddef>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

namespace sono {
namespace SONO_ISA {

#if defined(__AVX512F__)
constexpr int kBytes = 64;
constexpr int kUnroll = 4;
#elif defined(__AVX2__)
constexpr int kBytes = 32;
constexpr int kUnroll = 2;
#else
constexpr int kBytes = 16;
constexpr int kUnroll = 2;
#endif

typedef float VecF __attribute__((vector_size(kBytes)));
typedef double VecD __attribute__((vector_size(kBytes)));

template <class T> struct VecOf;
template <> struct VecOf<float> { using type = VecF; };
template <> struct VecOf<double> { using type = VecD; };
template <class T> using Vec = typename VecOf<T>::type;
template <class T> constexpr int lanes = kBytes / static_cast<int>(sizeof(T));

template <class T> inline Vec<T> splat(T value) { return Vec<T>{} + value; }

template <class T> inline Vec<T> load(const T *from) {
    Vec<T> v;
    std::memcpy(&v, from, sizeof v);
    return v;
}

template <class T> inline void store(T *to, Vec<T> v) { std::memcpy(to, &v, sizeof v); }

// A vector that lies across two that were stored before: taken from both where that is possible, since a
// load across two recent stores has to wait until both have reached the cache.
class Window {
  public:
    explicit Window(int offset) : offset_(offset) {
        for (int lane = 0; lane < lanes<float>; ++lane) lane_[lane] = lane + offset;
    }
    /// The second vector lies `apart` floats after the first.
    VecF operator()(const float *first, std::ptrdiff_t apart) const {
#if defined(__AVX512F__)
        return (VecF)_mm512_permutex2var_ps((__m512)load(first), (__m512i)lane_, (__m512)load(first + apart));
#else
        alignas(kBytes) float both[2 * lanes<float>];
        store(both, load(first)), store(both + lanes<float>, load(first + apart));
        return load(both + offset_);
#endif
    }

  private:
    typedef int VecI __attribute__((vector_size(kBytes)));
    int offset_;
    VecI lane_;
};

template <class V> inline V newton(V x, V y) { return y * (1.5f - 0.5f * x * y * y); }
inline VecD newton(VecD x, VecD y) { return y * (1.5 - 0.5 * x * y * y); }

// Stores around the caches, where `to` is aligned to the vector.
inline void store_past_caches(float *to, VecF v) {
#if defined(__AVX512F__)
    _mm512_stream_ps(to, (__m512)v);
#elif defined(__AVX2__)
    _mm256_stream_ps(to, (__m256)v);
#elif defined(__SSE2__)
    _mm_stream_ps(to, (__m128)v);
#else
    store(to, v);
#endif
}

// Makes such stores visible to other threads before whatever signals them.
inline void fence_past_caches() {
#if defined(__SSE2__)
    _mm_sfence();
#endif
}

// 1/sqrt(x) to 4e-4 or better: one Newton step short of float precision.
inline VecF rsqrt_estimate(VecF x) {
#if defined(__AVX512F__)
    return (VecF)_mm512_rsqrt14_ps((__m512)x);
#elif defined(__AVX2__)
    return (VecF)_mm256_rsqrt_ps((__m256)x);
#elif defined(__SSE2__)
    return (VecF)_mm_rsqrt_ps((__m128)x);
#elif defined(__aarch64__)
    const float32x4_t estimate = vrsqrteq_f32((float32x4_t)x);  // to 2^-8
    return (VecF)newton(x, (VecF)estimate);
#else
    VecF y;
    for (int i = 0; i < lanes<float>; ++i) y[i] = 1.0f / __builtin_sqrtf(x[i]);
    return y;
#endif
}

// 1/sqrt(x) for x > 0, to about 3e-7 (float) and 3e-16 (double): a hardware
// estimate and Newton steps are several times faster than the square root unit.
inline VecF rsqrt(VecF x) { return newton(x, rsqrt_estimate(x)); }

inline VecD rsqrt(VecD x) {
#if defined(__AVX512F__)
    return newton(x, newton(x, (VecD)_mm512_rsqrt14_pd((__m512d)x)));
#elif defined(__AVX2__)
    return 1.0 / (VecD)_mm256_sqrt_pd((__m256d)x);
#elif defined(__SSE2__)
    return 1.0 / (VecD)_mm_sqrt_pd((__m128d)x);
#elif defined(__aarch64__)
    return 1.0 / (VecD)vsqrtq_f64((float64x2_t)x);
#else
    VecD y;
    for (int i = 0; i < lanes<double>; ++i) y[i] = 1.0 / __builtin_sqrt(x[i]);
    return y;
#endif
}

// 1/x to about 1e-7, by an estimate and a Newton step: division stalls the pipeline.
inline VecF reciprocal(VecF x) {
#if defined(__AVX512F__)
    const VecF y = (VecF)_mm512_rcp14_ps((__m512)x);
#elif defined(__AVX2__)
    const VecF y = (VecF)_mm256_rcp_ps((__m256)x);
#elif defined(__SSE2__)
    const VecF y = (VecF)_mm_rcp_ps((__m128)x);
#else
    return 1.0f / x;
#endif
#if defined(__SSE2__)
    return y * (2.0f - x * y);
#endif
}

// sqrt(x) and 1/sqrt(x) together; both 0 at x = 0, which is what sums over a
// centre itself need (r = 0, and grad r taken as 0 at its kink).
template <class T> struct Root { Vec<T> r, inverse; };

template <class T> inline Root<T> root(Vec<T> x) {
#if !defined(__AVX512F__)
    if constexpr (sizeof(T) == 8) {
#if defined(__AVX2__)
        const VecD r = (VecD)_mm256_sqrt_pd((__m256d)x);
#elif defined(__SSE2__)
        const VecD r = (VecD)_mm_sqrt_pd((__m128d)x);
#elif defined(__aarch64__)
        const VecD r = (VecD)vsqrtq_f64((float64x2_t)x);
#else
        VecD r;
        for (int i = 0; i < lanes<double>; ++i) r[i] = __builtin_sqrt(x[i]);
#endif
        return {r, x > 0.0 ? 1.0 / r : splat<double>(0.0)};
    } else
#endif
    {
        constexpr T tiny = sizeof(T) == 8 ? T(1e-290) : T(1e-35);
        const Vec<T> y = rsqrt(x > tiny ? x : splat<T>(tiny));
        return {x * y, x > tiny ? y : splat<T>(0)};
    }
}

}  // namespace SONO_ISA
}  // namespace sono

// A message is a polynomial over GF(2), its first bit the highest; its check is the remainder of it, times x^64, by
// x^64 + kPolynomial.
#include "igtl/crc64.hpp"

#include <array>
#include <cstring>

#include "common/kernels.hpp"

#ifdef SONO_X86
#include <immintrin.h>
#endif

namespace sono {
namespace {

constexpr std::uint64_t kPolynomial = 0x42F0E1EBA9EA3693;

constexpr std::uint64_t times_x(std::uint64_t value) { return (value << 1) ^ (value >> 63 ? kPolynomial : 0); }

/// x^n modulo the polynomial, n >= 64.
constexpr std::uint64_t power_of_x(int n) {
    std::uint64_t value = kPolynomial;
    for (; n > 64; --n) value = times_x(value);
    return value;
}

/// Row k: what each byte comes to with k more bytes behind it.
using Tables = std::array<std::array<std::uint64_t, 256>, 8>;

constexpr Tables make_tables() {
    Tables tables{};
    for (int byte = 0; byte < 256; ++byte) {
        std::uint64_t value = std::uint64_t(byte) << 56;
        for (auto &row : tables) {
            for (int bit = 0; bit < 8; ++bit) value = times_x(value);
            row[byte] = value;
        }
    }
    return tables;
}

constexpr Tables kTables = make_tables();

std::uint64_t big_endian(const std::uint8_t *bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < 8; ++i) value = value << 8 | bytes[i];
    return value;
}

std::uint64_t by_tables(const std::uint8_t *bytes, std::size_t size, std::uint64_t crc) {
    for (; size >= 8; bytes += 8, size -= 8) {
        const std::uint64_t value = crc ^ big_endian(bytes);
        crc = 0;
        for (int k = 0; k < 8; ++k) crc ^= kTables[k][value >> (8 * k) & 0xff];
    }
    for (; size; ++bytes, --size) crc = (crc << 8) ^ kTables[0][(crc >> 56) ^ *bytes];
    return crc;
}

#ifdef SONO_X86
#define SONO_CARRYLESS __attribute__((target("pclmul,ssse3,sse4.1")))

SONO_CARRYLESS inline __m128i block(const std::uint8_t *bytes) {
    const __m128i reversed = _mm_set_epi8(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    return _mm_shuffle_epi8(_mm_loadu_si128(reinterpret_cast<const __m128i *>(bytes)), reversed);
}

/// A block with others behind it, and the block at their end, as one block there: `ahead` is x^(n + 64) and x^n for n
/// bits between the two places.
SONO_CARRYLESS inline __m128i folded(__m128i front, __m128i ahead, __m128i behind) {
    const __m128i high = _mm_clmulepi64_si128(front, ahead, 0x11), low = _mm_clmulepi64_si128(front, ahead, 0x00);
    return _mm_xor_si128(_mm_xor_si128(high, low), behind);
}

template <int Bits> SONO_CARRYLESS inline __m128i ahead_by() {
    constexpr std::uint64_t high = power_of_x(Bits + 64), low = power_of_x(Bits);
    return _mm_set_epi64x(static_cast<long long>(high), static_cast<long long>(low));
}

/// Four blocks at a time by carry-less products; 64 bytes or more.
SONO_CARRYLESS std::uint64_t by_products(const std::uint8_t *bytes, std::size_t size, std::uint64_t crc) {
    const __m128i ahead = ahead_by<512>(), next = ahead_by<128>();
    __m128i blocks[4];
    for (int k = 0; k < 4; ++k) blocks[k] = block(bytes + 16 * k);
    blocks[0] = _mm_xor_si128(blocks[0], _mm_set_epi64x(static_cast<long long>(crc), 0));
    for (bytes += 64, size -= 64; size >= 64; bytes += 64, size -= 64)
        for (int k = 0; k < 4; ++k) blocks[k] = folded(blocks[k], ahead, block(bytes + 16 * k));
    for (int k = 1; k < 4; ++k) blocks[k] = folded(blocks[k - 1], next, blocks[k]);
    std::uint8_t last[16];
    _mm_storeu_si128(reinterpret_cast<__m128i *>(last), block(reinterpret_cast<const std::uint8_t *>(&blocks[3])));
    return by_tables(bytes, size, by_tables(last, 16, 0));
}

bool has_products() {
    static const bool has = __builtin_cpu_supports("pclmul") && __builtin_cpu_supports("ssse3") &&
                            __builtin_cpu_supports("sse4.1");
    return has && std::strcmp(kernels().name, "baseline") != 0;
}
#endif

}  // namespace

std::uint64_t crc64(const std::uint8_t *bytes, std::size_t size, std::uint64_t start) {
#ifdef SONO_X86
    if (size >= 64 && has_products()) return by_products(bytes, size, start);
#endif
    return by_tables(bytes, size, start);
}

}  // namespace sono

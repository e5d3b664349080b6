// The check of OpenIGTLink's messages: CRC-64 of ECMA-182, first bit first, from zero, nothing inverted.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sono {

/// The check of `size` bytes that follow others whose check is `start`.
std::uint64_t crc64(const std::uint8_t *bytes, std::size_t size, std::uint64_t start);

}  // namespace sono

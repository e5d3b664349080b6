// What the core demands of its arguments, at its border: a wrong one is a ValueError in Python, never a wrong address.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>

namespace sono {

/// Nodes along an axis that a float tells apart, and nodes of a lattice that 32 bits number.
constexpr std::size_t kMostAlongAxis = std::size_t(1) << 24, kMostNodes = INT32_MAX;

inline void require(bool met, const char *otherwise) {
    if (!met) throw std::invalid_argument(otherwise);
}

template <class Numbers> bool all_finite(const Numbers &numbers) {
    return std::all_of(std::begin(numbers), std::end(numbers), [](double x) { return std::isfinite(x); });
}

inline void require_spacing(const std::array<double, 3> &spacing) {
    require(all_finite(spacing) && *std::min_element(spacing.begin(), spacing.end()) > 0,
            "spacing is not three lengths above 0");
}

/// Whether each axis has `fewest` entries or more, and all of them can be numbered.
inline bool numbered(const std::array<std::size_t, 3> &shape, std::size_t fewest) {
    std::size_t nodes = 1;
    for (const std::size_t n : shape) {
        if (n < fewest || n > kMostAlongAxis) return false;
        nodes *= n;
        if (nodes > kMostNodes) return false;
    }
    return true;
}

/// x towards zero as a whole number from low to high; low where x is no number.
template <class Whole, class T> Whole whole_within(T x, T low, T high) {
    return static_cast<Whole>(std::min(std::max(low, x), high));
}

}  // namespace sono

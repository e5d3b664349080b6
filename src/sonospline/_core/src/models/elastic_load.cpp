#include "models/elastic_load.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "common/row_kernels.hpp"

namespace sono {
namespace {

constexpr double kReach = 5.6;  // in widths: e^(-5.6^2 / 2) is 1.6e-7

// Rows that come no nearer to the line than kReach stay zero.
bool near_line(const float start[3], const LineLoad &line, float length, float reach) {
    float across[3], turn[3], along = 0;
    for (int a = 0; a < 3; ++a) along += start[a] * line.direction[a];
    double b = 0, c = 0, a2 = 0;
    for (int a = 0; a < 3; ++a) {
        across[a] = start[a] - along * line.direction[a];
        turn[a] = (a == 2) - line.direction[2] * line.direction[a];
        a2 += turn[a] * turn[a], b += across[a] * turn[a], c += across[a] * across[a];
    }
    const double nearest = a2 > 1e-12 ? std::clamp(-b / a2, 0.0, static_cast<double>(length)) : 0;
    return c + nearest * (2 * b + nearest * a2) < static_cast<double>(reach) * reach;
}

// Integrals times the hat functions along one axis, by Numerov's weights 1, 10, 1 over 12: `count` values, `stride`
// apart, `width` of them side by side.
void weigh_along(float *values, std::size_t count, std::size_t stride, std::size_t width, float spacing) {
    std::vector<float> before(width, 0.f), here(width);
    const float twelfth = spacing / 12;
    for (std::size_t i = 0; i < count; ++i) {
        float *const row = values + i * stride;
        const float diagonal = i == 0 || i + 1 == count ? 5.f : 10.f;
        std::copy_n(row, width, here.data());
        if (i + 1 < count)
            for (std::size_t q = 0; q < width; ++q) row[q] = twelfth * (before[q] + diagonal * here[q] + row[q + stride]);
        else
            for (std::size_t q = 0; q < width; ++q) row[q] = twelfth * (before[q] + diagonal * here[q]);
        before.swap(here);
    }
}

void weigh_along_row(float *row, std::size_t count, float spacing) {
    const float twelfth = spacing / 12;
    float before = 0;
    for (std::size_t k = 0; k < count; ++k) {
        const float here = row[k], after = k + 1 < count ? row[k + 1] : 0;
        row[k] = twelfth * (before + (k == 0 || k + 1 == count ? 5.f : 10.f) * here + after);
        before = here;
    }
}

}  // namespace

void line_load(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing, const AxialForce &force,
               float *out) {
    const double width = force.width, per_length = 1 / (std::sqrt(2.0) * width), pi = std::acos(-1.0);
    const double across = 1 / (2 * pi * width * width);
    LineLoad line{};
    std::vector<float> places, halves;
    for (std::size_t i = 0; i < force.count; ++i) {
        places.push_back(static_cast<float>(force.places[i] * per_length));
        halves.push_back(static_cast<float>(0.5 * force.changes[i] * across));
    }
    for (int a = 0; a < 3; ++a) line.direction[a] = static_cast<float>(force.direction[a]);
    line.places = places.data(), line.halves = halves.data(), line.steps = force.count;
    line.depth = static_cast<float>(force.depth * per_length);
    line.tip = static_cast<float>(force.tip * across / (std::sqrt(2 * pi) * width));
    line.per_length = static_cast<float>(per_length);
    const std::size_t row = shape[2], plane = shape[1] * row, size = shape[0] * plane;
    const auto step = static_cast<float>(spacing[2]), length = step * static_cast<float>(row - 1);
    const auto reach = static_cast<float>(kReach * width);
    parallel_for(size > 40000 ? shape[0] : 1, [&](std::size_t block) {
        const std::size_t end = size > 40000 ? block + 1 : shape[0];
        for (std::size_t i = block; i < end; ++i) {
            bool any = false;
            for (std::size_t j = 0; j < shape[1]; ++j) {
                float *const to = out + i * plane + j * row;
                const float start[3] = {static_cast<float>(static_cast<double>(i) * spacing[0] - force.origin[0]),
                                        static_cast<float>(static_cast<double>(j) * spacing[1] - force.origin[1]),
                                        static_cast<float>(-force.origin[2])};
                if (near_line(start, line, length, reach)) {
                    kernels().rows->line_row(line, start, step, row, to);
                    weigh_along_row(to, row, step);
                    any = true;
                } else {
                    std::fill_n(to, row, 0.f);
                }
            }
            if (any) weigh_along(out + i * plane, shape[1], row, row, static_cast<float>(spacing[1]));
        }
    });
    weigh_along(out, shape[0], plane, plane, static_cast<float>(spacing[0]));
    for (int a = 2; a >= 0; --a)
        for (std::size_t i = 0; i < size; ++i)
            out[static_cast<std::size_t>(a) * size + i] = line.direction[a] * out[i];
}

}  // namespace sono

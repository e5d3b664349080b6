#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>

#include <utility>

#include "common/bindings.hpp"
#include "fields/resampling.hpp"
#include "fields/sampling.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Values = Array<float, -1, -1, -1, 3>;
using Weights = Array<float, -1, -1>;
using Planes = Array<float, 3, -1, -1, -1>;

sono::LatticeField lattice_field(const Values &values, const std::array<double, 3> &spacing, int order) {
    require(order == 1 || order == 3, "order is neither 1 nor 3");
    for (const std::size_t n : lattice_of(values))
        require(n >= (order == 3 ? 4u : 2u), "values has fewer nodes along an axis than its order takes: 2, or 4");
    sono::require_spacing(spacing);
    return {values.data(), lattice_of(values), spacing, order};
}

nb::ndarray<nb::numpy, double> sample_lattice(const Values &values, const std::array<double, 3> &spacing,
                                              const Rows &points, int order) {
    const auto field = lattice_field(values, spacing, order);
    auto out = new_array<double, 2>({points.shape(0), 3});
    const Outside outside;
    sono::sample_lattice(field, points.data(), points.shape(0), out.data());
    return out;
}

nb::ndarray<nb::numpy, double> gradient_lattice(const Values &coefficients, const std::array<double, 3> &spacing,
                                                const Rows &points) {
    const auto field = lattice_field(coefficients, spacing, 3);
    auto out = new_array<double, 3>({points.shape(0), 3, 3});
    const Outside outside;
    sono::gradient_lattice(field, points.data(), points.shape(0), out.data());
    return out;
}

auto invert_lattice(const Values &values, const std::array<double, 3> &spacing, const Rows &points, double tolerance,
                    int most, int order) {
    const auto field = lattice_field(values, spacing, order);
    require(most >= 0 && most <= 1'000'000, "most is not between 0 and 1000000");
    auto out = new_array<double, 2>({points.shape(0), 3});
    auto iterations = new_array<std::int32_t, 1>({points.shape(0)});
    {
        const Outside outside;
        sono::invert_lattice(field, points.data(), points.shape(0), tolerance, most, out.data(), iterations.data());
    }
    return std::pair(out, iterations);
}

sono::AxisWeights axis_weights(const Weights &weights) {
    return {weights.data(), weights.shape(0), weights.shape(1)};
}

nb::ndarray<nb::numpy, float> resample_lattice(const Planes &values, const Weights &x, const Weights &y,
                                               const Weights &z_transposed) {
    require(values.shape(1) >= 4 && values.shape(2) >= 4 && values.shape(3) >= 1,
            "values has fewer than 4 nodes along x or y, or none along z");
    require(x.shape(1) == values.shape(1) + 2 && y.shape(1) == values.shape(2) + 2 &&
                z_transposed.shape(0) == values.shape(3),
            "x, y or z_transposed has not the columns that values takes");
    const sono::Resampling weights{axis_weights(x), axis_weights(y), z_transposed.data(), z_transposed.shape(0),
                                   z_transposed.shape(1)};
    auto out = new_array<float, 4>({x.shape(0), y.shape(0), z_transposed.shape(1), 3});
    const Outside outside;
    sono::resample_lattice(weights, values.data(), out.data());
    return out;
}

}  // namespace

void bind_sampling(nb::module_ &m) {
    m.def("sample_lattice", &sample_lattice, "values"_a, "spacing"_a, "points"_a, "order"_a = 1);
    m.def("gradient_lattice", &gradient_lattice, "coefficients"_a, "spacing"_a, "points"_a);
    m.def("invert_lattice", &invert_lattice, "values"_a, "spacing"_a, "points"_a, "tolerance"_a, "most"_a,
          "order"_a = 1);
    m.def("resample_lattice", &resample_lattice, "values"_a, "x"_a, "y"_a, "z_transposed"_a);
}

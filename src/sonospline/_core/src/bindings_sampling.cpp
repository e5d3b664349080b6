#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>

#include <utility>

#include "bindings.hpp"
#include "sampling.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Values = nb::ndarray<const float, nb::shape<-1, -1, -1, 3>, nb::c_contig, nb::device::cpu>;

sono::LatticeField lattice_field(const Values &values, const std::array<double, 3> &spacing) {
    return {values.data(), {values.shape(0), values.shape(1), values.shape(2)}, spacing};
}

nb::ndarray<nb::numpy, double> sample_lattice(Values values, const std::array<double, 3> &spacing, Rows points) {
    auto out = new_array<double, 2>({points.shape(0), 3});
    nb::gil_scoped_release release;
    sono::sample_lattice(lattice_field(values, spacing), points.data(), points.shape(0), out.data());
    return out;
}

auto invert_lattice(Values values, const std::array<double, 3> &spacing, Rows points, double tolerance, int most) {
    auto out = new_array<double, 2>({points.shape(0), 3});
    auto iterations = new_array<std::int32_t, 1>({points.shape(0)});
    {
        nb::gil_scoped_release release;
        sono::invert_lattice(lattice_field(values, spacing), points.data(), points.shape(0), tolerance, most,
                             out.data(), iterations.data());
    }
    return std::pair(out, iterations);
}

}  // namespace

void bind_sampling(nb::module_ &m) {
    m.def("sample_lattice", &sample_lattice, "values"_a, "spacing"_a, "points"_a);
    m.def("invert_lattice", &invert_lattice, "values"_a, "spacing"_a, "points"_a, "tolerance"_a, "most"_a);
}

// Python side of the elastic solver; its NumPy twin has the documentation.
#include "common/bindings.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <tuple>
#include <vector>

#include "models/elastic.hpp"
#include "models/elastic_load.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Cells = Array<float, -1, -1, -1>;
using Nodes = Array<float, 3, -1, -1, -1>;
using Square = Array<float, -1, -1>;
using Values = Array<double, -1>;
using Vector3 = Array<double, 3>;
using NewNodes = nb::ndarray<nb::numpy, float>;

void make(sono::ElasticMultigrid *self, const nb::sequence &given, const std::array<bool, 6> &pinned, bool full,
          int degree, const Square &coarse_inverse) {
    const auto levels = items_of<std::tuple<std::array<double, 3>, Cells, Cells>>(given);
    std::vector<sono::ElasticLevelData> data;
    for (const auto &[spacing, lame, shear] : levels) {
        require(lattice_of(lame) == lattice_of(shear), "lame and shear differ in shape");
        require(sono::numbered(lattice_of(lame), 1), "lame has no cell along an axis, or too many");
        sono::require_spacing(spacing);
        data.push_back({lattice_of(lame), spacing, lame.data(), shear.data()});
    }
    require(coarse_inverse.shape(0) == coarse_inverse.shape(1), "coarse_inverse is not square");
    const Outside outside;
    new (self) sono::ElasticMultigrid(data, pinned, full, degree, coarse_inverse.data(), coarse_inverse.shape(0));
}

void check(const sono::ElasticMultigrid &solver, const Nodes &values) {
    for (std::size_t a = 0; a < 3; ++a)
        require(values.shape(a + 1) == solver.shape()[a], "values are not of the solver's shape");
}

NewNodes like(const Nodes &values) {
    return new_array<float, 4>({3, values.shape(1), values.shape(2), values.shape(3)});
}

auto iterate(sono::ElasticMultigrid &solver, const Nodes &load, const Nodes &start, int iterations, bool estimate) {
    check(solver, load), check(solver, start);
    require(iterations >= 0 && iterations <= 10'000, "iterations is not between 0 and 10000");
    NewNodes out = like(start);
    sono::ElasticOutcome outcome;
    {
        const Outside outside;
        std::copy_n(start.data(), start.size(), out.data());
        outcome = solver.iterate(load.data(), out.data(), iterations, estimate);
    }
    return std::tuple(out, outcome.errors, outcome.sound);
}

NewNodes product(sono::ElasticMultigrid &solver, const Nodes &values) {
    check(solver, values);
    NewNodes out = like(values);
    const Outside outside;
    solver.product(values.data(), out.data());
    return out;
}

NewNodes line_load(const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing, const Vector3 &origin,
                   const Vector3 &direction, const Values &places, const Values &changes, double depth, double tip,
                   double width) {
    require(sono::numbered(shape, 1), "shape has no node along an axis, or too many");
    sono::require_spacing(spacing);
    require(places.size() == changes.size(), "places and changes differ in length");
    require(std::isfinite(width) && width > 0, "width is not a length above 0");
    NewNodes out = new_array<float, 4>({3, shape[0], shape[1], shape[2]});
    const auto vector = [](const Vector3 &v) { return std::array<double, 3>{v(0), v(1), v(2)}; };
    const sono::AxialForce force{vector(origin), vector(direction), places.data(), changes.data(), places.size(),
                                 depth,          tip,               width};
    const Outside outside;
    sono::line_load(shape, spacing, force, out.data());
    return out;
}

}  // namespace

void bind_elastic(nb::module_ &m) {
    nb::class_<sono::ElasticMultigrid>(m, "ElasticMultigrid")
        .def("__init__", &make, "levels"_a, "pinned"_a, "full"_a, "degree"_a, "coarse_inverse"_a)
        .def("iterate", &iterate, "load"_a, "start"_a, "iterations"_a, "estimate"_a)
        .def("product", &product, "values"_a);
    m.def("line_load", &line_load, "shape"_a, "spacing"_a, "origin"_a, "direction"_a, "places"_a, "changes"_a,
          "depth"_a, "tip"_a, "width"_a);
}

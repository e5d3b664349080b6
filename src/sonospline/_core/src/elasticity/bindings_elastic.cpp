// Python side of the elastic solver; its NumPy twin has the documentation.
#include "common/bindings.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <vector>

#include "elasticity/elastic.hpp"
#include "elasticity/elastic_galerkin.hpp"
#include "elasticity/elastic_history.hpp"
#include "elasticity/elastic_inverse.hpp"
#include "elasticity/elastic_load.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Cells = Array<float, -1, -1, -1>;
using Nodes = Array<float, 3, -1, -1, -1>;
using Terms = Array<float, -1, 3, -1, -1, -1>;
using Places = Array<std::int64_t, -1, 3>;
using Stiffness = Array<float, -1, 6, 6>;
using Square = Array<float, -1, -1>;
using Filter = Array<double, -1, -1>;
using Values = Array<double, -1>;
using Vector3 = Array<double, 3>;
using NewNodes = nb::ndarray<nb::numpy, float>;
using Mask = Array<std::uint8_t, -1, -1, -1>;
using Matrix24 = Array<double, 24, 24>;
using Stencil = Array<float, sono::kStencilFloats, -1, -1, -1>;
using Lattice = std::array<std::size_t, 3>;

Lattice nodes_of(const Stencil &stencil) { return {stencil.shape(1), stencil.shape(2), stencil.shape(3)}; }

void require_nodes_of(const Lattice &cells, const Mask &fixed) {
    for (std::size_t a = 0; a < 3; ++a) require(fixed.shape(a) == cells[a] + 1, "fixed is not over the nodes of the cells");
}

void require_coarser(const Lattice &nodes, const Lattice &coarse) {
    for (std::size_t a = 0; a < 3; ++a)
        require(nodes[a] >= 2 && (coarse[a] == nodes[a] || coarse[a] == nodes[a] / 2 + 1),
                "coarse has neither as many nodes along an axis nor every second of them");
}

void make(sono::ElasticMultigrid *self, const nb::sequence &given, const std::array<bool, 6> &pinned,
          bool full, int degree, const Square &coarse_inverse, const std::optional<Mask> &fixed,
          const nb::sequence &given_stencils, const std::optional<Places> &layered,
          const std::optional<Stiffness> &excess, const std::optional<Nodes> &springs) {
    const auto levels = items_of<std::tuple<std::array<double, 3>, Cells, Cells>>(given);
    std::vector<sono::ElasticLevelData> data;
    for (const auto &[spacing, lame, shear] : levels) {
        require(lattice_of(lame) == lattice_of(shear), "lame and shear differ in shape");
        require(sono::numbered(lattice_of(lame), 1), "lame has no cell along an axis, or too many");
        sono::require_spacing(spacing);
        data.push_back({lattice_of(lame), spacing, lame.data(), shear.data(), pinned, nullptr, full});
    }
    if (fixed && !data.empty()) {
        require_nodes_of(data.front().cells, *fixed);
        data.front().fixed = fixed->data();
    }
    if (springs && !data.empty()) {
        for (std::size_t a = 0; a < 3; ++a)
            require(springs->shape(a + 1) == data.front().cells[a] + 1, "springs are not over the nodes of the cells");
        data.front().springs = springs->data();
    }
    const auto stencils = items_of<Stencil>(given_stencils);
    require(!levels.empty(), "levels is empty");
    std::vector<sono::ElasticStencilData> explicit_data;
    for (const Stencil &stencil : stencils) {
        Lattice finer = explicit_data.empty() ? lattice_of(std::get<1>(levels.at(levels.size() - 1))) : explicit_data.back().nodes;
        if (explicit_data.empty())
            for (std::size_t &n : finer) ++n;
        require_coarser(finer, nodes_of(stencil));
        explicit_data.push_back({nodes_of(stencil), stencil.data()});
    }
    require(coarse_inverse.shape(0) == coarse_inverse.shape(1), "coarse_inverse is not square");
    require(layered.has_value() == excess.has_value(), "layered and excess belong together");
    sono::ElasticLayersData layers{nullptr, nullptr, 0};
    if (layered) {
        require(layered->shape(0) == excess->shape(0), "layered and excess differ in length");
        for (std::size_t i = 0; i < layered->size(); ++i)
            require(layered->data()[i] >= 0 && static_cast<std::size_t>(layered->data()[i]) < data.front().cells[i % 3],
                    "layered has a cell beyond the grid");
        layers = {layered->data(), excess->data(), layered->shape(0)};
    }
    const Outside outside;
    new (self) sono::ElasticMultigrid(data, explicit_data, degree, coarse_inverse.data(), coarse_inverse.shape(0), layers);
}

NewNodes galerkin_of_cells(const Cells &lame, const Cells &shear, const Matrix24 &dilatation, const Matrix24 &distortion,
                           const Mask &fixed, const Lattice &coarse) {
    require(lattice_of(lame) == lattice_of(shear), "lame and shear differ in shape");
    require(sono::numbered(lattice_of(lame), 1), "lame has no cell along an axis, or too many");
    require_nodes_of(lattice_of(lame), fixed);
    require_coarser(lattice_of(fixed), coarse);
    NewNodes out = new_array<float, 4>({sono::kStencilFloats, coarse[0], coarse[1], coarse[2]});
    const Outside outside;
    sono::galerkin_of_cells({lattice_of(lame), lame.data(), shear.data(), dilatation.data(), distortion.data(), fixed.data()},
                            coarse, out.data());
    return out;
}

NewNodes galerkin_of_stencil(const Stencil &stencil, const Lattice &coarse) {
    require_coarser(nodes_of(stencil), coarse);
    NewNodes out = new_array<float, 4>({sono::kStencilFloats, coarse[0], coarse[1], coarse[2]});
    const Outside outside;
    sono::galerkin_of_stencil(stencil.data(), nodes_of(stencil), coarse, out.data());
    return out;
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
        outcome = solver.iterate(load.data(), start.data(), iterations, estimate, out.data());
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

NewNodes followed(const Terms &fields, const Nodes &start, const Nodes &change, const Values &forgotten,
                  const Values &taken_up, double nil) {
    for (std::size_t a = 0; a < 4; ++a) {
        require(start.shape(a) == fields.shape(a + 1), "start is not of the shape of the fields");
        require(change.shape(a) == fields.shape(a + 1), "change is not of the shape of the fields");
    }
    require(forgotten.size() == fields.shape(0) && taken_up.size() == fields.shape(0),
            "forgotten and taken_up are not of one number a field");
    NewNodes out = new_array<float, 5>({fields.shape(0), 3, start.shape(1), start.shape(2), start.shape(3)});
    const sono::Following f{fields.shape(0), start.size(),     fields.data(),  start.data(),
                            change.data(),   forgotten.data(), taken_up.data()};
    float *const to = static_cast<float *>(out.data());
    const Outside outside;
    sono::follow(f, static_cast<float>(nil), to);
    return out;
}

sono::SmoothedPoints smoothed(const Lattice &shape, const std::array<double, 3> &spacing, const Rows &points,
                              double width, const std::array<bool, 6> &mirrored) {
    require(sono::numbered(shape, 2), "shape has fewer than two nodes along an axis, or too many");
    sono::require_spacing(spacing);
    require(std::all_of(points.data(), points.data() + points.size(), [](double x) { return std::isfinite(x); }),
            "points are not finite");
    require(std::isfinite(width) && width > 0, "width is not a length above 0");
    return {points.data(), points.shape(0), width, mirrored};
}

NewNodes nodal_forces(const Lattice &shape, const std::array<double, 3> &spacing, const Rows &points,
                      const Values &amounts, const Vector3 &direction, double width,
                      const std::array<bool, 6> &mirrored) {
    const sono::SmoothedPoints where = smoothed(shape, spacing, points, width, mirrored);
    require(points.shape(0) == amounts.size(), "points and amounts differ in length");
    NewNodes out = new_array<float, 4>({3, shape[0], shape[1], shape[2]});
    const std::array<double, 3> along{direction(0), direction(1), direction(2)};
    const Outside outside;
    sono::nodal_forces(shape, spacing, where, amounts.data(), along, out.data());
    return out;
}

NewNodes nodal_force_vectors(const Lattice &shape, const std::array<double, 3> &spacing, const Rows &points,
                             const Rows &forces, double width, const std::array<bool, 6> &mirrored) {
    const sono::SmoothedPoints where = smoothed(shape, spacing, points, width, mirrored);
    require(points.shape(0) == forces.shape(0), "points and forces differ in length");
    NewNodes out = new_array<float, 4>({3, shape[0], shape[1], shape[2]});
    const Outside outside;
    sono::nodal_force_vectors(shape, spacing, where, forces.data(), out.data());
    return out;
}

sono::NodalSpline spline(const Nodes &displacement, const std::array<double, 3> &spacing, const Filter &x, const Filter &y,
                         const Filter &z, const Rows &points) {
    const Lattice shape{displacement.shape(1), displacement.shape(2), displacement.shape(3)};
    require(sono::numbered(shape, 2), "displacement has fewer than two nodes along an axis, or too many");
    sono::require_spacing(spacing);
    const Filter *const filters[3] = {&x, &y, &z};
    for (std::size_t a = 0; a < 3; ++a)
        require(filters[a]->shape(0) == shape[a] + 2 && filters[a]->shape(1) == shape[a],
                "x, y or z is not of the nodes of displacement and two more");
    require(std::all_of(points.data(), points.data() + points.size(), [](double x) { return std::isfinite(x); }),
            "points are not finite");
    return {shape, spacing, displacement.data(), {x.data(), y.data(), z.data()}};
}

nb::ndarray<nb::numpy, double> undeformed_points(const Nodes &displacement, const std::array<double, 3> &spacing,
                                                 const Filter &x, const Filter &y, const Filter &z,
                                                 const Rows &points, const Rows &start, int iterations) {
    const sono::NodalSpline u = spline(displacement, spacing, x, y, z, points);
    require(start.shape(0) == points.shape(0), "start and points differ in length");
    require(iterations >= 0 && iterations <= 10'000, "iterations is not between 0 and 10000");
    auto out = new_array<double, 2>({points.shape(0), 3});
    std::copy_n(start.data(), start.size(), out.data());
    const Outside outside;
    sono::undeformed_points(u, points.data(), iterations, points.shape(0), out.data());
    return out;
}

nb::ndarray<nb::numpy, double> displacement_at(const Nodes &displacement, const std::array<double, 3> &spacing,
                                               const Filter &x, const Filter &y, const Filter &z, const Rows &points) {
    const sono::NodalSpline u = spline(displacement, spacing, x, y, z, points);
    auto out = new_array<double, 2>({points.shape(0), 3});
    const Outside outside;
    sono::displacement_at(u, points.data(), points.shape(0), out.data());
    return out;
}

}  // namespace

void bind_elastic(nb::module_ &m) {
    nb::class_<sono::ElasticMultigrid>(m, "ElasticMultigrid")
        .def("__init__", &make, "levels"_a, "pinned"_a, "full"_a, "degree"_a, "coarse_inverse"_a,
             "fixed"_a = nb::none(), "stencils"_a = nb::tuple(),
             "layered"_a = nb::none(), "excess"_a = nb::none(), "springs"_a = nb::none())
        .def("iterate", &iterate, "load"_a, "start"_a, "iterations"_a, "estimate"_a)
        .def("product", &product, "values"_a);
    m.def("galerkin_of_cells", &galerkin_of_cells, "lame"_a, "shear"_a, "dilatation"_a, "distortion"_a, "fixed"_a,
          "coarse"_a);
    m.def("galerkin_of_stencil", &galerkin_of_stencil, "stencil"_a, "coarse"_a);
    m.def("nodal_force_vectors", &nodal_force_vectors, "shape"_a, "spacing"_a, "points"_a, "forces"_a, "width"_a,
          "mirrored"_a);
    m.def("nodal_forces", &nodal_forces, "shape"_a, "spacing"_a, "points"_a, "amounts"_a, "direction"_a, "width"_a,
          "mirrored"_a);
    m.def("followed", &followed, "fields"_a, "start"_a, "change"_a, "forgotten"_a, "taken_up"_a, "nil"_a);
    m.def("displacement_at", &displacement_at, "displacement"_a, "spacing"_a, "x"_a, "y"_a, "z"_a, "points"_a);
    m.def("undeformed_points", &undeformed_points, "displacement"_a, "spacing"_a, "x"_a, "y"_a, "z"_a,
          "points"_a, "start"_a, "iterations"_a);
}

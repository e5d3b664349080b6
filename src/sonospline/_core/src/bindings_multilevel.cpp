// Python side of the multilevel sum; its NumPy twin has the documentation. Indices are
// checked here: a wrong one would write outside the result.
#include "bindings.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <optional>

#include "multilevel.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Index = nb::ndarray<const std::int64_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<float, nb::numpy, nb::shape<-1, -1, -1, 3>, nb::c_contig, nb::device::cpu>;

void check(const sono::MultilevelPlan &plan, const Index &index, const Rows &weights,
           const std::optional<Out> &out) {
    if (index.shape(0) != weights.shape(0)) throw nb::value_error("centre_index and weights differ in length");
    for (std::size_t a = 0; a < 3; ++a) {
        const auto nodes = static_cast<std::int64_t>(plan.shape()[a]);
        if (out && out->shape(a) != plan.shape()[a]) throw nb::value_error("out is not of the plan's shape");
        for (std::size_t j = 0; j < index.shape(0); ++j)
            if (index(j, a) < 0 || index(j, a) >= nodes)
                throw nb::value_error("centre_index has a node outside the lattice");
    }
}

Out evaluate(sono::MultilevelPlan &plan, Index index, Rows weights, Affine affine, int depth,
             std::optional<Out> out) {
    check(plan, index, weights, out);
    const auto &n = plan.shape();
    Out result = out ? *out : Out(new_array<float, 4>({n[0], n[1], n[2], 3}));
    float *const data = result.data();
    {
        const Outside outside;
        plan.evaluate(index.data(), weights.data(), index.shape(0), affine.data(), depth, data);
    }
    return result;
}

}  // namespace

void bind_multilevel(nb::module_ &m) {
    nb::class_<sono::MultilevelPlan>(m, "MultilevelPlan")
        .def(nb::init<const std::array<std::size_t, 3> &, const std::array<double, 3> &, double,
                      const std::vector<int> &>(),
             "shape"_a, "spacing"_a, "tolerance"_a = 3e-5, "orders"_a = std::vector<int>{6, 8, 8})
        .def_prop_ro("max_depth", &sono::MultilevelPlan::max_depth)
        .def("depth", &sono::MultilevelPlan::depth, "centres"_a, nb::call_guard<Outside>())
        .def("error_per_weight", &sono::MultilevelPlan::error_per_weight, "depth"_a)
        .def("evaluate", &evaluate, "centre_index"_a, "weights"_a, "affine"_a, "depth"_a = 0,
             "out"_a.none() = nb::none());
}

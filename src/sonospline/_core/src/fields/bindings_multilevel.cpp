// Python side of the multilevel sum; its NumPy twin has the documentation.
#include "common/bindings.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>

#include <optional>
#include <vector>

#include "fields/multilevel.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Index = Array<std::int64_t, -1, 3>;
using Result = nb::ndarray<float, nb::numpy, nb::shape<-1, -1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Out = Checked<Result>;

void make(sono::MultilevelPlan *self, const std::array<std::size_t, 3> &shape, const std::array<double, 3> &spacing,
          double tolerance, const nb::sequence &given) {
    const std::vector<int> orders = items_of<int>(given);
    const Outside outside;
    new (self) sono::MultilevelPlan(shape, spacing, tolerance, orders);
}

Result evaluate(sono::MultilevelPlan &plan, const Index &index, const Rows &weights, const Affine &affine, int depth,
                const std::optional<Out> &out) {
    const auto &n = plan.shape();
    require(index.shape(0) == weights.shape(0), "centre_index and weights differ in length");
    require(!out || lattice_of(*out) == n, "out is not of the plan's shape");
    Result result = out ? Result(*out) : Result(new_array<float, 4>({n[0], n[1], n[2], 3}));
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
        .def("__init__", &make, "shape"_a, "spacing"_a, "tolerance"_a = 3e-5, "orders"_a = nb::make_tuple(6, 8, 8))
        .def_prop_ro("max_depth", &sono::MultilevelPlan::max_depth, nb::call_guard<Outside>())
        .def("depth", &sono::MultilevelPlan::depth, "centres"_a, nb::call_guard<Outside>())
        .def("error_per_weight", &sono::MultilevelPlan::error_per_weight, "depth"_a, nb::call_guard<Outside>())
        .def("evaluate", &evaluate, "centre_index"_a, "weights"_a, "affine"_a, "depth"_a = 0,
             "out"_a.none() = nb::none());
}

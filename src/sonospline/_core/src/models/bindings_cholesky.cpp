#include "common/bindings.hpp"
#include "models/cholesky.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Matrix = Array<double, -1, -1>;
using Columns = Checked<nb::ndarray<double, nb::shape<3, -1>, nb::c_contig, nb::device::cpu>>;

bool append(sono::CholeskyFactor &factor, const Matrix &rows, double smallest_pivot) {
    const Outside outside;
    return factor.append(rows.data(), rows.shape(0), rows.shape(1), smallest_pivot);
}

void solve(sono::CholeskyFactor &factor, const Columns &x, std::size_t first) {
    const Outside outside;
    factor.solve(x.data(), x.shape(1), first);
}

}  // namespace

void bind_cholesky(nb::module_ &m) {
    nb::class_<sono::CholeskyFactor>(m, "CholeskyFactor")
        .def(nb::init<>())
        .def_prop_ro("size", &sono::CholeskyFactor::size)
        .def("append", &append, "rows"_a, "smallest_pivot"_a)
        .def("reserve", &sono::CholeskyFactor::reserve, "rows"_a, nb::call_guard<Outside>())
        .def("truncate", &sono::CholeskyFactor::truncate, "size"_a, nb::call_guard<Outside>())
        .def("solve", &solve, "x"_a, "first"_a = 0);
}

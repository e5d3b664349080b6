#include "bindings.hpp"
#include "cholesky.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Columns = nb::ndarray<double, nb::shape<3, -1>, nb::c_contig, nb::device::cpu>;

bool append(sono::CholeskyFactor &factor, Matrix rows, double smallest_pivot) {
    if (rows.shape(1) != factor.size() + rows.shape(0)) throw nb::value_error("rows must be (m, size + m)");
    const Outside outside;
    return factor.append(rows.data(), rows.shape(0), smallest_pivot);
}

void solve(sono::CholeskyFactor &factor, Columns x, std::size_t first) {
    if (x.shape(1) > factor.size()) throw nb::value_error("x must be (3, size or less)");
    const Outside outside;
    factor.solve(x.data(), x.shape(1), first);
}

}  // namespace

void bind_cholesky(nb::module_ &m) {
    nb::class_<sono::CholeskyFactor>(m, "CholeskyFactor")
        .def(nb::init<>())
        .def_prop_ro("size", &sono::CholeskyFactor::size)
        .def("append", &append, "rows"_a, "smallest_pivot"_a)
        .def("reserve", &sono::CholeskyFactor::reserve, "rows"_a)
        .def("truncate", &sono::CholeskyFactor::truncate, "size"_a)
        .def("solve", &solve, "x"_a, "first"_a = 0);
}

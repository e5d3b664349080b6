// Python side of the sums of kernels. The interpreter's lock is let go in every sum.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>

#include <cmath>

#include "common/bindings.hpp"
#include "common/kernels.hpp"
#include "fields/sums.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

sono::Kernel kernel_of(int number) {
    sono::require(number == 0 || number == 1, "kernel is neither 0 (r) nor 1 (r^3)");
    return static_cast<sono::Kernel>(number);
}

sono::KernelSum kernel_sum(int kernel, const Rows &centres, const Rows &weights, const Affine &affine) {
    sono::require(centres.shape(0) == weights.shape(0), "centres and weights differ in length");
    return {kernel_of(kernel), centres.data(), weights.data(), centres.shape(0), affine.data()};
}

template <class T>
nb::ndarray<nb::numpy, T> sum_at_points(int kernel, const Rows &points, const Rows &centres, const Rows &weights,
                                        const Affine &affine) {
    const auto sum = kernel_sum(kernel, centres, weights, affine);
    auto out = new_array<T, 2>({points.shape(0), 3});
    const Outside outside;
    sono::sum_at_points<T>(sum, points.data(), points.shape(0), out.data());
    return out;
}

template <class T>
nb::ndarray<nb::numpy, T> sum_on_lattice(int kernel, const std::array<std::size_t, 3> &shape,
                                         const std::array<double, 3> &spacing, const Rows &centres, const Rows &weights,
                                         const Affine &affine) {
    const auto sum = kernel_sum(kernel, centres, weights, affine);
    auto out = new_array<T, 4>({shape[0], shape[1], shape[2], 3});
    const Outside outside;
    sono::sum_on_lattice<T>(sum, shape, spacing, out.data());
    return out;
}

nb::ndarray<nb::numpy, double> gradient_at_points(int kernel, const Rows &points, const Rows &centres,
                                                  const Rows &weights, const Affine &affine) {
    const auto sum = kernel_sum(kernel, centres, weights, affine);
    auto out = new_array<double, 3>({points.shape(0), 3, 3});
    const Outside outside;
    sono::gradient_at_points(sum, points.data(), points.shape(0), out.data());
    return out;
}

nb::ndarray<nb::numpy, double> kelvinlet_sum(const Rows &points, const Rows &centres, const Rows &forces, double width,
                                             double poissons_ratio) {
    sono::require(centres.shape(0) == forces.shape(0), "centres and forces differ in length");
    auto out = new_array<double, 2>({points.shape(0), 3});
    const double a = 1 / (4 * std::acos(-1.0)), b = a / (4 * (1 - poissons_ratio));
    const sono::Kelvinlet kernel{a - b, 0.5 * a * width * width, b, width * width};
    const Outside outside;
    sono::kelvinlet_sum(kernel, points.data(), points.shape(0), centres.data(), forces.data(), centres.shape(0),
                        out.data());
    return out;
}

nb::ndarray<nb::numpy, double> kernel_matrix(int kernel, const Rows &points, const Rows &centres) {
    const sono::Kernel radial = kernel_of(kernel);
    auto out = new_array<double, 2>({points.shape(0), centres.shape(0)});
    const Outside outside;
    sono::kernel_matrix(radial, points.data(), points.shape(0), centres.data(), centres.shape(0), out.data());
    return out;
}

}  // namespace

void bind_sums(nb::module_ &m) {
    m.def("sum_at_points_f32", &sum_at_points<float>, "kernel"_a, "points"_a, "centres"_a, "weights"_a, "affine"_a);
    m.def("sum_at_points_f64", &sum_at_points<double>, "kernel"_a, "points"_a, "centres"_a, "weights"_a, "affine"_a);
    m.def("sum_on_lattice_f32", &sum_on_lattice<float>, "kernel"_a, "shape"_a, "spacing"_a, "centres"_a,
          "weights"_a, "affine"_a);
    m.def("sum_on_lattice_f64", &sum_on_lattice<double>, "kernel"_a, "shape"_a, "spacing"_a, "centres"_a,
          "weights"_a, "affine"_a);
    m.def("gradient_at_points", &gradient_at_points, "kernel"_a, "points"_a, "centres"_a, "weights"_a, "affine"_a);
    m.def("kelvinlet_sum", &kelvinlet_sum, "points"_a, "centres"_a, "forces"_a, "width"_a, "poissons_ratio"_a);
    m.def("kernel_matrix", &kernel_matrix, "kernel"_a, "points"_a, "centres"_a);
}

// Python side of contact; its NumPy twin has the documentation.
#include "common/bindings.hpp"

#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <tuple>
#include <vector>

#include "contact/clipped_forces.hpp"
#include "contact/shaft_forces.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Square = Array<double, -1, -1>;
using Values = Array<double, -1>;
using Marks = Array<std::uint8_t, -1>;

auto clipped_forces(const Square &compliance, const Values &apart, const Values &low, const Values &high,
                    const Values &start, int sweeps, double tolerance) {
    const std::size_t n = apart.size();
    require(compliance.shape(0) == n && compliance.shape(1) == n, "compliance is not square, of the length of apart");
    require(low.size() == n && high.size() == n && start.size() == n, "low, high or start is not of the length of apart");
    for (std::size_t i = 0; i < n; ++i) {
        require(compliance.data()[i * n + i] > 0, "compliance has no diagonal above 0");
        require(low.data()[i] <= high.data()[i], "low is above high");
    }
    require(sweeps >= 0 && sweeps <= 100'000, "sweeps is not between 0 and 100000");
    auto out = new_array<double, 1>({n});
    sono::Buffer<double> beyond(n);
    const Outside outside;
    std::copy_n(start.data(), n, out.data());
    const sono::Contact contact{compliance.data(), apart.data(), low.data(), high.data(), n};
    const int taken = sono::clipped_forces(contact, out.data(), beyond.data(), sweeps, tolerance);
    return std::tuple(out, taken);
}

auto stick_slip(const Square &compliance, const Values &behind, const Values &end, const Values &bond,
                const Values &anchors, const Values &axial, double tip, const Marks &sliding, const Values &bounds,
                double limit, double slow, int sweeps, double tolerance) {
    const std::size_t m = behind.size();
    require(compliance.shape(0) == m && compliance.shape(1) == m, "compliance is not square, of the length of behind");
    for (const Values *values : {&end, &anchors, &axial, &bounds})
        require(values->size() == m, "end, anchors, axial or bounds is not of the length of behind");
    require(sliding.size() == m, "sliding is not of the length of behind");
    require(bond.size() == m + 1, "bond is not one longer than behind");
    for (std::size_t i = 0; i < m; ++i) {
        require(compliance.data()[i * m + i] >= 0, "compliance has a diagonal below 0");
        require(bounds.data()[i] >= 0, "bounds or limit is below 0");
    }
    require(std::all_of(bond.data(), bond.data() + m + 1, [](double x) { return x > 0; }), "bond is not above 0");
    require(limit >= 0, "bounds or limit is below 0");
    require(slow >= 0, "slow is below 0");
    require(sweeps >= 0 && sweeps <= 100'000, "sweeps is not between 0 and 100000");
    auto forces = new_array<double, 1>({m}), places = new_array<double, 1>({m});
    double ahead;
    {
        const Outside outside;
        std::copy_n(axial.data(), m, forces.data());
        std::copy_n(anchors.data(), m, places.data());
        const sono::ShaftPoints shaft{compliance.data(), behind.data(), end.data(), bond.data(),
                                      bounds.data(),     sliding.data(), m,         limit};
        ahead = sono::stick_slip(shaft, {slow, sweeps, tolerance}, forces.data(), places.data(), tip);
    }
    return std::tuple(forces, places, tip, ahead);
}

auto forces_across(const Square &compliance, const Array<double, 2, 3> &axes, const Marks &held, const Rows &wanted,
                   double soft, double least) {
    const std::size_t m = held.size(), n = wanted.shape(0);
    require(compliance.shape(0) == 3 * m && compliance.shape(1) == 3 * m, "compliance is not square, of three times held");
    require(soft >= 0 && least >= 0, "soft or least is below 0");
    std::vector<std::size_t> which;
    for (std::size_t i = 0; i < m; ++i)
        if (held.data()[i]) which.push_back(i);
    require(which.size() == n, "wanted is not of the points held");
    auto out = new_array<double, 2>({n, 3});
    const Outside outside;
    sono::forces_across({compliance.data(), axes.data(), which.data(), n, m, soft, least}, wanted.data(), out.data());
    return out;
}

}  // namespace

void bind_contact(nb::module_ &m) {
    m.def("clipped_forces", &clipped_forces, "compliance"_a, "apart"_a, "low"_a, "high"_a, "start"_a, "sweeps"_a,
          "tolerance"_a);
    m.def("stick_slip", &stick_slip, "compliance"_a, "behind"_a, "end"_a, "bond"_a, "anchors"_a, "axial"_a, "tip"_a,
          "sliding"_a, "bounds"_a, "limit"_a, "slow"_a, "sweeps"_a, "tolerance"_a);
    m.def("forces_across", &forces_across, "compliance"_a, "axes"_a, "held"_a, "wanted"_a, "soft"_a, "least"_a);
}

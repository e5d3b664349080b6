// Python side of contact; its NumPy twin has the documentation.
#include "common/bindings.hpp"

#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <tuple>

#include "contact/clipped_forces.hpp"
#include "contact/shaft_forces.hpp"
#include "contact/track.hpp"

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

/// A new array with the values of one that is read.
template <class T> auto copied(const Array<T, -1> &values) {
    auto copy = new_array<T, 1>({values.size()});
    std::copy_n(values.data(), values.size(), copy.data());
    return copy;
}

auto copied(const Rows &values) {
    auto copy = new_array<double, 2>({values.shape(0), 3});
    std::copy_n(values.data(), values.size(), copy.data());
    return copy;
}

auto cut_on(const Square &compliance, const Values &behind, const Values &bond, const Array<double, 4, -1> &resistance,
            const Values &anchors, const Values &axial, double tip, double cut, const Marks &sliding, const Marks &used,
            double apart, double reuse, double speed, double membrane, double rupture, double slow, int sweeps,
            double tolerance, double ends, double grown, int most) {
    const std::size_t m = behind.size();
    require(m > 0 && compliance.shape(0) == m && compliance.shape(1) == m,
            "compliance is not square, of the length of behind");
    require(anchors.size() == m && axial.size() == m, "anchors or axial is not of the length of behind");
    require(sliding.size() == m && used.size() == m, "sliding or used is not of the length of behind");
    require(bond.size() == m + 1, "bond is not one longer than behind");
    require(resistance.shape(1) == m, "resistance is not four of the length of behind");
    for (std::size_t i = 0; i < m; ++i) require(compliance.data()[i * m + i] >= 0, "compliance has a diagonal below 0");
    const auto not_below = [](double x) { return x >= 0; };
    require(std::all_of(resistance.data(), resistance.data() + 4 * m, not_below) && rupture >= 0,
            "resistance or rupture is below 0");
    require(std::all_of(bond.data(), bond.data() + m + 1, [](double x) { return x > 0; }), "bond is not above 0");
    require(slow >= 0, "slow is below 0");
    require(sweeps >= 0 && sweeps <= 100'000 && most >= 0 && most <= 100'000,
            "sweeps or most is not between 0 and 100000");
    auto places = copied(anchors), forces = copied(axial), bounds = new_array<double, 1>({m});
    auto slides = copied(sliding), left = copied(used);
    sono::Track track{{behind.data(), behind.data() + m}, {}, places.data(), forces.data(), slides.data(), left.data(),
                      tip, cut, cut};
    bool breaks;
    {
        const Outside outside;
        breaks = sono::cut_on({compliance.data(), bond.data(), resistance.data(), m, apart, reuse, speed, membrane, rupture},
                              {{slow, sweeps, tolerance}, ends, grown, most}, track);
        std::copy_n(track.bounds.data(), m, bounds.data());
    }
    return std::tuple(places, forces, track.tip, track.cut, slides, left, bounds, track.reached, breaks);
}

auto held_across(const Square &compliance, const Rows &places, const Array<double, 3> &axis, const Marks &held,
                 const Rows &offsets, const Rows &lateral, double share, double bond, double soft, double least) {
    const std::size_t m = held.size();
    require(compliance.shape(0) == 3 * m && compliance.shape(1) == 3 * m, "compliance is not square, of three times held");
    for (const Rows *rows : {&places, &offsets, &lateral})
        require(rows->shape(0) == m, "places, offsets or lateral is not of held");
    require(share > 0, "share is not above 0");
    require(bond >= 0 && soft >= 0 && least >= 0, "bond, soft or least is below 0");
    const auto count = m - static_cast<std::size_t>(std::count(held.data(), held.data() + m, 0));
    auto forces = copied(lateral), beside = copied(offsets);
    const Outside outside;
    sono::held_across({compliance.data(), places.data(), axis.data(), held.data(), count, m, share, bond, soft, least},
                      beside.data(), forces.data());
    return std::tuple(forces, beside);
}

}  // namespace

void bind_contact(nb::module_ &m) {
    m.def("clipped_forces", &clipped_forces, "compliance"_a, "apart"_a, "low"_a, "high"_a, "start"_a, "sweeps"_a,
          "tolerance"_a);
    m.def("cut_on", &cut_on, "compliance"_a, "behind"_a, "bond"_a, "resistance"_a, "anchors"_a, "axial"_a, "tip"_a,
          "cut"_a, "sliding"_a, "used"_a, "apart"_a, "reuse"_a, "speed"_a, "membrane"_a, "rupture"_a, "slow"_a, "sweeps"_a,
          "tolerance"_a, "ends"_a, "grown"_a, "most"_a);
    m.def("held_across", &held_across, "compliance"_a, "places"_a, "axis"_a, "held"_a, "offsets"_a, "lateral"_a, "share"_a,
          "bond"_a, "soft"_a, "least"_a);
}

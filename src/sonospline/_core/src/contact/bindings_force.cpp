// Python side of the force in the hand; its NumPy twin has the documentation.
#include "common/bindings.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <tuple>
#include <vector>

#include "contact/force_law.hpp"
#include "contact/force_loop.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Square = Array<double, -1, -1>;
using Values = Array<double, -1>;
using Three = Array<double, 3>;
using NewValues = nb::ndarray<nb::numpy, double>;

constexpr std::size_t kMostPoints = 1000, kMostHands = 1'000'000;
constexpr double kMost = 1e9;  // of a number: what is made of such numbers stays one

bool bounded(const double *first, std::size_t n) {
    return std::all_of(first, first + n, [](double x) { return std::fabs(x) <= kMost; });
}

/// A contact that others handed over, checked whole.
sono::FrozenContact checked(const Square &compliance, const Values &places, const Values &displacement,
                            const Values &forces, const Values &anchors, const Values &low, const Values &high,
                            std::ptrdiff_t tip, const Three &axis, const Three &origin, double lateral_stiffness,
                            const Three &lateral_force) {
    const std::size_t n = places.size();
    require(n >= 1 && n <= kMostPoints, "places is not of 1 to 1000 points");
    require(compliance.shape(0) == n && compliance.shape(1) == n, "compliance is not square, of the length of places");
    require(bounded(compliance.data(), n * n), "compliance is not finite");
    for (std::size_t i = 0; i < n; ++i) require(compliance.data()[i * n + i] > 0, "compliance has no diagonal above 0");
    for (const Values *values : {&places, &displacement, &forces, &anchors, &low, &high}) {
        require(values->size() == n, "displacement, forces, anchors, low or high is not of the length of places");
        require(bounded(values->data(), n), "places, displacement, forces, anchors, low or high is not finite");
    }
    for (std::size_t i = 0; i < n; ++i)
        require(low.data()[i] <= 0 && high.data()[i] >= 0, "low is above 0, or high below it");
    require(tip >= -1 && tip < static_cast<std::ptrdiff_t>(n), "tip is neither -1 nor a point");
    for (const Three *three : {&axis, &origin, &lateral_force})
        require(bounded(three->data(), 3), "axis, origin or lateral_force is not finite");
    const double *d = axis.data();
    require(std::fabs(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1) < 1e-6, "axis is not of length 1");
    require(lateral_stiffness >= 0 && lateral_stiffness <= kMost, "lateral_stiffness is not at or above 0");
    const auto held = [n](const Values &values) { return std::vector<double>(values.data(), values.data() + n); };
    const auto three = [](const Three &a) { return sono::Vector3{a.data()[0], a.data()[1], a.data()[2]}; };
    return {n, tip < 0 ? n : static_cast<std::size_t>(tip), {compliance.data(), compliance.data() + n * n},
            held(places), held(displacement), held(forces), held(anchors), held(low), held(high), three(axis),
            three(origin), lateral_stiffness, three(lateral_force)};
}

sono::ForceOptions options_of(const Values &numbers, int sweeps) {
    const double *o = numbers.data();
    require(numbers.size() == 17, "options are not 17 numbers");
    require(std::all_of(o, o + 17, [](double x) { return x >= 0 && x <= kMost; }), "options are not at or above 0");
    for (const int positive : {0, 1, 5, 6, 7, 8, 9, 12, 15})
        require(o[positive] > 0, "options are not above 0 where they divide");
    require(o[0] >= 5e-5 && o[0] <= 0.1, "period is not between 0.05 and 100 ms");
    require(o[3] <= 1, "delay is above a second");
    require(sweeps >= 1 && sweeps <= 1000, "sweeps is not between 1 and 1000");
    return {o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8], o[9], o[10], o[11], o[12], o[13], o[14], o[15],
            sweeps, o[16]};
}

// --- in virtual time, any number of hands on a contact of each ---

class Hands {
  public:
    Hands(std::size_t hands, const sono::ForceOptions &of_all) : options(of_all), laws_(hands, sono::ForceLaw(of_all)) {}
    std::size_t size() const { return laws_.size(); }

    /// What `body` makes of the laws, one caller at a time, without the interpreter's lock.
    template <class Body> auto use(const Body &body) {
        const Outside outside;
        const std::lock_guard<std::mutex> lock(in_use_);
        return body(laws_);
    }

    const sono::ForceOptions options;

  private:
    std::vector<sono::ForceLaw> laws_;
    std::mutex in_use_;
};

void make_hands(Hands *self, std::ptrdiff_t hands, const Values &options, int sweeps) {
    require(hands >= 1 && hands <= static_cast<std::ptrdiff_t>(kMostHands), "hands is not between 1 and 1000000");
    new (self) Hands(static_cast<std::size_t>(hands), options_of(options, sweeps));
}

void renew(Hands &self, const Square &compliance, const Values &places, const Values &displacement,
           const Values &forces, const Values &anchors, const Values &low, const Values &high, std::ptrdiff_t tip,
           const Three &axis, const Three &origin, double lateral_stiffness, const Three &lateral_force) {
    const sono::PreparedContact contact(checked(compliance, places, displacement, forces, anchors, low, high, tip, axis,
                                                origin, lateral_stiffness, lateral_force),
                                        self.options);
    std::vector<std::shared_ptr<sono::PreparedContact>> each;
    for (std::size_t i = 0; i < self.size(); ++i) each.push_back(std::make_shared<sono::PreparedContact>(contact));
    self.use([&](std::vector<sono::ForceLaw> &laws) {
        for (std::size_t i = 0; i < each.size(); ++i) laws[i].renew(std::move(each[i]));
    });
}

NewValues tick(Hands &self, const Rows &positions, const Values &device_age, double contact_age) {
    const std::size_t hands = self.size();
    require(positions.shape(0) == hands && device_age.size() == hands, "positions or device_age is not one a hand");
    auto out = new_array<double, 2>({hands, 3});
    double *forces = out.data();
    self.use([&](std::vector<sono::ForceLaw> &laws) {
        for (std::size_t i = 0; i < hands; ++i) {
            const double *p = positions.data() + 3 * i;
            const sono::Vector3 force = laws[i].tick({{p[0], p[1], p[2]}, device_age.data()[i], contact_age});
            std::copy_n(force.data(), 3, forces + 3 * i);
        }
    });
    return out;
}

struct State {
    std::size_t points = 0;
    std::vector<double> forces, anchors, numbers;
};

/// Hands that have not been heard of since have another contact, which may have fewer points: zeros stand for those.
State state_of(const std::vector<sono::ForceLaw> &laws) {
    const auto points = [](const sono::ForceLaw &law) { return law.contact() ? law.contact()->contact.n : 0; };
    State found;
    for (const sono::ForceLaw &law : laws) found.points = std::max(found.points, points(law));
    found.forces.assign(laws.size() * found.points, 0.0);
    found.anchors = found.forces;
    for (std::size_t i = 0; i < laws.size(); ++i) {
        if (const sono::PreparedContact *contact = laws[i].contact()) {
            const auto at = static_cast<std::ptrdiff_t>(i * found.points);
            std::copy_n(contact->forces.data(), points(laws[i]), found.forces.begin() + at);
            std::copy_n(contact->anchors.data(), points(laws[i]), found.anchors.begin() + at);
        }
        for (const double number : {laws[i].stretch(), laws[i].fade(), laws[i].stored()}) found.numbers.push_back(number);
    }
    return found;
}

/// Forces and anchors (hands, n), and stretch, fade and stored (hands, 3).
auto state(Hands &self) {
    const State found = self.use([](const std::vector<sono::ForceLaw> &laws) { return state_of(laws); });
    const auto shown = [&self](const std::vector<double> &values, std::size_t columns) {
        auto out = new_array<double, 2>({self.size(), columns});
        std::copy(values.begin(), values.end(), out.data());
        return out;
    };
    return std::tuple(shown(found.forces, found.points), shown(found.anchors, found.points), shown(found.numbers, 3));
}

// --- in real time ---

void make_loop(sono::ForceLoop *self, const Values &options, int sweeps) {
    new (self) sono::ForceLoop(options_of(options, sweeps));
}

void publish(sono::ForceLoop &self, const Square &compliance, const Values &places, const Values &displacement,
             const Values &forces, const Values &anchors, const Values &low, const Values &high, std::ptrdiff_t tip,
             const Three &axis, const Three &origin, double lateral_stiffness, const Three &lateral_force) {
    self.publish(checked(compliance, places, displacement, forces, anchors, low, high, tip, axis, origin,
                         lateral_stiffness, lateral_force));
}

void place(sono::ForceLoop &self, const Three &position) {
    self.place({position.data()[0], position.data()[1], position.data()[2]});
}

void stop(sono::ForceLoop &self) {
    const WithoutGil others_run;
    self.stop();
}

auto reading(const sono::ForceLoop &self) {
    const auto [force, advance, stretch, fade, stored, heard, fresh] = self.read();
    return std::tuple(force, advance, stretch, fade, stored, heard > 0, fresh > 0);
}

auto timing(const sono::ForceLoop &self) {
    return std::tuple(self.real_time.load(), self.ticks.load(), self.skipped.load(), self.computed.quantile(0.5),
                      self.computed.quantile(0.99), self.late.quantile(0.999));
}

void forget_timing(sono::ForceLoop &self) {
    self.computed.clear();
    self.late.clear();
    self.ticks.store(0);
    self.skipped.store(0);
}

}  // namespace

void bind_force(nb::module_ &m) {
    nb::class_<Hands>(m, "ForceLaw")
        .def("__init__", &make_hands, "hands"_a, "options"_a, "sweeps"_a)
        .def("renew", &renew, "compliance"_a, "places"_a, "displacement"_a, "forces"_a, "anchors"_a, "low"_a, "high"_a,
             "tip"_a, "axis"_a, "origin"_a, "lateral_stiffness"_a, "lateral_force"_a)
        .def("tick", &tick, "positions"_a, "device_age"_a, "contact_age"_a)
        .def("state", &state);
    nb::class_<sono::ForceLoop>(m, "ForceLoop")
        .def("__init__", &make_loop, "options"_a, "sweeps"_a)
        .def("publish", &publish, "compliance"_a, "places"_a, "displacement"_a, "forces"_a, "anchors"_a, "low"_a,
             "high"_a, "tip"_a, "axis"_a, "origin"_a, "lateral_stiffness"_a, "lateral_force"_a)
        .def("place", &place, "position"_a)
        .def("start", &sono::ForceLoop::start)
        .def("stop", &stop)
        .def("running", &sono::ForceLoop::running)
        .def("reading", &reading)
        .def("timing", &timing)
        .def("forget_timing", &forget_timing);
}

// What the core computes without Python, as sums that two processors can be compared by.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "common/parallel.hpp"
#include "elasticity/elastic.hpp"
#include "elasticity/elastic_load.hpp"
#include "fields/multilevel.hpp"
#include "fields/sums.hpp"

namespace {

std::uint32_t seed = 7;
float any() { return static_cast<float>((seed = seed * 1664525u + 1013904223u) >> 8) / (1 << 24); }
std::vector<float> values(std::size_t count, float low) {
    std::vector<float> all(count);
    for (float &value : all) value = low + any();
    return all;
}

template <class T> void say(const char *what, const std::vector<T> &found) {
    double mixed = 0, squares = 0;
    for (std::size_t i = 0; i < found.size(); ++i)
        mixed += found[i] * std::sin(0.37 * static_cast<double>(i)), squares += found[i] * found[i];
    std::printf("%s %.9e %.9e\n", what, mixed, std::sqrt(squares));
}

sono::ElasticLevelData level(std::size_t cells, double side, const std::vector<float> &lame, const std::vector<float> &shear) {
    return {{cells, cells, cells}, {side, side, side}, lame.data(), shear.data(), {false, true, true, true, true, true}, nullptr, false};
}

void elastic() {
    const std::size_t n = 3 * 13 * 13 * 13;
    const std::vector<float> lame = values(1728, 1), shear = values(1728, 1), coarse = values(216, 1), load = values(n, -0.5f);
    sono::ElasticMultigrid solver({level(12, 1, lame, shear), level(6, 2, coarse, coarse)}, {}, 3, nullptr, 0, {nullptr, nullptr, 0});
    const std::vector<float> rest(n, 0.f);
    std::vector<float> found(n);
    solver.iterate(load.data(), rest.data(), 4, true, found.data());
    say("elastic", found);
}

void nodal_load() {
    const double places[] = {3.3, 4.1, 5.2, 6.6, 7.7, 3.1}, amounts[] = {1, 2};
    std::vector<float> found(3 * 13 * 13 * 13);
    sono::nodal_forces({13, 13, 13}, {1, 1, 1}, {places, 2, 1.3, {true, false, false, false, false, false}}, amounts, {.1, .2, .3},
                       found.data());
    say("load", found);
}

void spline() {
    constexpr std::size_t kLandmarks = 200;
    sono::MultilevelPlan plan({33, 33, 33}, {1 / 32., 1 / 32., 1 / 32.}, 1.7e-5, {6, 8, 8});
    std::vector<std::int64_t> nodes(3 * kLandmarks);
    std::vector<double> weights(3 * kLandmarks);
    for (std::int64_t &node : nodes) node = static_cast<std::int64_t>(33 * any());
    for (double &weight : weights) weight = any() - 0.5;
    const double affine[12] = {0, .1, .2, .3};
    std::vector<float> found(3 * 33 * 33 * 33);
    plan.evaluate(nodes.data(), weights.data(), kLandmarks, affine, 2, found.data());
    say("spline", found);
}

}  // namespace

int main() {
    sono::set_thread_count(1);
    elastic(), nodal_load(), spline();
}

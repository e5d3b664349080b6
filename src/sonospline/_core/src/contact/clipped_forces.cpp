#include "contact/clipped_forces.hpp"

#include <algorithm>
#include <cmath>

namespace sono {

int clipped_forces(const Contact &contact, double *forces, double *beyond, int most, double tolerance) {
    const auto &[compliance, apart, low, high, n] = contact;
    std::copy_n(apart, n, beyond);
    // A row is a column, too: points are moved by one force at a time.
    const auto moved = [&, n = n, compliance = compliance](std::size_t i, double change) {
        const double *row = compliance + i * n;
        for (std::size_t j = 0; j < n; ++j) beyond[j] += change * row[j];
    };
    for (std::size_t i = 0; i < n; ++i) {
        forces[i] = std::min(std::max(forces[i], low[i]), high[i]);
        if (forces[i] != 0) moved(i, forces[i]);
    }
    for (int sweep = 0; sweep < most; ++sweep) {
        double largest = 0;
        for (std::size_t i = 0; i < n; ++i) {
            const double diagonal = compliance[i * n + i];
            const double wanted = std::min(std::max(forces[i] - beyond[i] / diagonal, low[i]), high[i]);
            const double change = wanted - forces[i];
            if (change == 0) continue;
            forces[i] = wanted;
            moved(i, change);
            largest = std::max(largest, std::fabs(change) * diagonal);
        }
        if (largest <= tolerance) return sweep + 1;
    }
    return most;
}

}  // namespace sono

#include "contact/shaft_forces.hpp"

#include <cmath>
#include <vector>

#include "contact/clipped_forces.hpp"

namespace sono {
namespace {

double dot(const double *a, const double *b, std::size_t n) {
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
}

/// Compliance of the points and of the tip, which is between two of them: (m + 1, m + 1).
std::vector<double> with_tip(const double *compliance, const double *end, std::size_t m) {
    const std::size_t n = m + 1;
    std::vector<double> whole(n * n);
    for (std::size_t i = 0; i < m; ++i) {
        const double *row = compliance + i * m;
        for (std::size_t j = 0; j < m; ++j) whole[i * n + j] = row[j];
        whole[i * n + m] = whole[m * n + i] = dot(row, end, m);
    }
    for (std::size_t i = 0; i < m; ++i) whole[n * n - 1] += end[i] * whole[m * n + i];
    return whole;
}

/// Solves a x = b for symmetric a (n, n), which is lost; b becomes x.
void solve(std::vector<double> &a, std::vector<double> &b) {
    const std::size_t n = b.size();
    std::vector<double> scaled(n);
    for (std::size_t j = 0; j < n; ++j) {  // a = L D L^T, row by row
        double *row = a.data() + j * n;
        for (std::size_t k = 0; k < j; ++k) {
            scaled[k] = row[k] - dot(scaled.data(), a.data() + k * n, k);
            row[k] = scaled[k] / a[k * n + k];
        }
        row[j] -= dot(scaled.data(), row, j);
        b[j] -= dot(row, b.data(), j);
    }
    for (std::size_t j = n; j-- > 0;) {
        b[j] /= a[j * n + j];
        for (std::size_t i = j + 1; i < n; ++i) b[j] -= a[i * n + j] * b[i];
    }
}

}  // namespace

double stick_slip(const ShaftPoints &shaft, const Search &search, double *axial, double *anchors, double &tip) {
    const auto &[compliance, before, end, bond, bounds, sliding, m, limit] = shaft;
    const std::size_t n = m + 1;
    std::vector<double> behind(before, before + m), change(m);
    const auto moved = [&, compliance = compliance, m = m] {
        for (std::size_t i = 0; i < m; ++i) behind[i] -= dot(compliance + i * m, change.data(), m);
    };
    // Points that slide rub along all of the shaft that they have come to stand for.
    for (std::size_t i = 0; i < m; ++i) {
        const double grown = sliding[i] ? (axial[i] > 0) * bounds[i] - (axial[i] < 0) * bounds[i] : axial[i];
        change[i] = grown - axial[i], axial[i] = grown;
    }
    moved();
    for (std::size_t i = 0; i < m; ++i)
        if (sliding[i]) anchors[i] += behind[i] - before[i] - bond[i] * change[i];

    std::vector<double> whole = with_tip(compliance, end, m);
    std::vector<double> forces(axial, axial + m), apart(n), low(n), high(n), beyond(n);
    forces.push_back(tip);
    for (std::size_t i = 0; i < n; ++i) {
        const double slow = search.slow * whole[i * n + i];
        const double held = i < m ? anchors[i] - behind[i] : -dot(end, behind.data(), m);
        apart[i] = held - dot(whole.data() + i * n, forces.data(), n) - slow * forces[i];
        low[i] = i < m ? -bounds[i] : 0, high[i] = i < m ? bounds[i] : limit;
        whole[i * n + i] += slow + bond[i];
    }
    const Contact contact{whole.data(), apart.data(), low.data(), high.data(), n};
    clipped_forces(contact, forces.data(), beyond.data(), search.sweeps, search.tolerance);

    for (std::size_t i = 0; i < m; ++i) change[i] = forces[i] - axial[i] + (forces[m] - tip) * end[i];
    moved();
    for (std::size_t i = 0; i < m; ++i) {
        axial[i] = forces[i];
        if (std::fabs(axial[i]) >= bounds[i]) anchors[i] = behind[i] - bond[i] * axial[i];
    }
    tip = forces[m];
    return -dot(end, behind.data(), m);
}

void forces_across(const HeldPoints &points, const double *wanted, double *forces) {
    const auto &[compliance, axes, held, n, m, soft, least] = points;
    std::vector<double> matrix(4 * n * n), found(2 * n);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t p = 0; p < 2; ++p) {
            const double *const to = axes + 3 * p;
            found[2 * i + p] = dot(to, wanted + 3 * i, 3);
            for (std::size_t j = 0; j < n; ++j) {
                double along[3] = {0, 0, 0};  // where the point goes along the axis, by a force along each of the world's
                for (std::size_t a = 0; a < 3; ++a)
                    for (std::size_t b = 0; b < 3; ++b)
                        along[b] += to[a] * compliance[(3 * held[i] + a) * 3 * m + 3 * held[j] + b];
                for (std::size_t q = 0; q < 2; ++q) matrix[(2 * i + p) * 2 * n + 2 * j + q] = dot(along, axes + 3 * q, 3);
            }
        }
    for (std::size_t i = 0; i < 2 * n; ++i) matrix[i * 2 * n + i] += soft * matrix[i * 2 * n + i] + least;
    solve(matrix, found);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t a = 0; a < 3; ++a) forces[3 * i + a] = found[2 * i] * axes[a] + found[2 * i + 1] * axes[3 + a];
}

}  // namespace sono

#include "contact/shaft_forces.hpp"

#include <array>
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

/// Two unit vectors across an axis, by Duff et al., J. Comput. Graph. Tech. 6 (2017) 1.
std::array<double, 6> axes_across(const double *axis) {
    const double x = axis[0], y = axis[1], z = axis[2], sign = std::copysign(1.0, z);
    const double a = -1 / (sign + z), b = -x * y / (sign + z);
    return {1 + sign * a * x * x, sign * b, -sign * x, b, sign + a * y * y, -y};
}

}  // namespace

void stick_slip(const ShaftPoints &shaft, const Search &search, double *behind, double *axial, double *anchors,
                double &tip) {
    const auto &[compliance, end, bond, bounds, sliding, m, limit] = shaft;
    const std::size_t n = m + 1;
    std::vector<double> change(m);
    // Points that slide rub along all of the shaft that they have come to stand for.
    for (std::size_t i = 0; i < m; ++i) {
        const double grown = sliding[i] ? (axial[i] > 0) * bounds[i] - (axial[i] < 0) * bounds[i] : axial[i];
        change[i] = grown - axial[i], axial[i] = grown;
    }
    for (std::size_t i = 0; i < m; ++i) {
        const double moved = dot(compliance + i * m, change.data(), m);
        behind[i] -= moved;
        if (sliding[i]) anchors[i] -= moved + bond[i] * change[i];
    }

    std::vector<double> whole = with_tip(compliance, end, m);
    std::vector<double> forces(axial, axial + m), apart(n), low(n), high(n), beyond(n);
    forces.push_back(tip);
    for (std::size_t i = 0; i < n; ++i) {
        const double slow = search.slow * whole[i * n + i];
        const double held = i < m ? anchors[i] - behind[i] : -dot(end, behind, m);
        apart[i] = held - dot(whole.data() + i * n, forces.data(), n) - slow * forces[i];
        low[i] = i < m ? -bounds[i] : 0, high[i] = i < m ? bounds[i] : limit;
        whole[i * n + i] += slow + bond[i];
    }
    const Contact contact{whole.data(), apart.data(), low.data(), high.data(), n};
    clipped_forces(contact, forces.data(), beyond.data(), search.sweeps, search.tolerance);

    for (std::size_t i = 0; i < m; ++i) change[i] = forces[i] - axial[i] + (forces[m] - tip) * end[i];
    for (std::size_t i = 0; i < m; ++i) {
        behind[i] -= dot(compliance + i * m, change.data(), m);
        axial[i] = forces[i];
        if (std::fabs(axial[i]) >= bounds[i]) anchors[i] = behind[i] - bond[i] * axial[i];
    }
    tip = forces[m];
}

void held_across(const HeldPoints &points, double *offsets, double *lateral) {
    const auto &[compliance, places, axis, held, n, m, share, bond, soft, least] = points;
    const std::array<double, 6> axes = axes_across(axis);
    std::vector<double> matrix(4 * n * n), found(2 * n), sums(3 * n);
    std::vector<std::size_t> which;
    for (std::size_t i = 0; i < m; ++i) {
        const double *const row = compliance + 9 * m * i + 3 * i;
        const double own = (row[0] + row[3 * m + 1] + row[6 * m + 2]) / 3;
        double beside[2], force[2];
        for (std::size_t p = 0; p < 2; ++p) {
            const double *const to = axes.data() + 3 * p;
            beside[p] = dot(to, places + 3 * i, 3);
            force[p] = held[i] ? dot(to, lateral + 3 * i, 3) : 0;
            if (held[i])
                found[2 * which.size() + p] = dot(to, offsets + 3 * i, 3) - beside[p] - bond * own * force[p];
        }
        if (held[i]) which.push_back(i);
        for (std::size_t a = 0; a < 3; ++a) {
            lateral[3 * i + a] = force[0] * axes[a] + force[1] * axes[3 + a];
            if (!held[i]) offsets[3 * i + a] = beside[0] * axes[a] + beside[1] * axes[3 + a];
        }
    }
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t p = 0; p < 2; ++p) {
            const double *const to = axes.data() + 3 * p, *const rows = compliance + 9 * m * which[i];
            for (std::size_t j = 0; j < n; ++j) {  // where the point goes along the axis, by a force along each of the world's
                const double *const at = rows + 3 * which[j];
                for (std::size_t b = 0; b < 3; ++b)
                    sums[3 * j + b] = to[0] * at[b] + to[1] * at[3 * m + b] + to[2] * at[6 * m + b];
            }
            double *const row = matrix.data() + (2 * i + p) * 2 * n;
            for (std::size_t j = 0; j < n; ++j)
                for (std::size_t q = 0; q < 2; ++q)
                    row[2 * j + q] = share * dot(sums.data() + 3 * j, axes.data() + 3 * q, 3);
            row[2 * i + p] += soft * row[2 * i + p] + least;
        }
    solve(matrix, found);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t a = 0; a < 3; ++a)
            lateral[3 * which[i] + a] += found[2 * i] * axes[a] + found[2 * i + 1] * axes[3 + a];
}

}  // namespace sono

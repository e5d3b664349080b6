#include "ultrasound/scatterers.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "ultrasound/brick_kernels.hpp"
#include "common/kernels.hpp"
#include "common/parallel.hpp"
#include "common/require.hpp"

namespace sono {
namespace {

constexpr std::ptrdiff_t kRowsPerUnit = 8;   // of bricks
constexpr std::size_t kRegionsAtOnce = 8;    // that are found while no view waits
constexpr int kBrickBits = 6;                // of a hash that pick a pattern
constexpr double kPi = 3.14159265358979323846;
constexpr double kNeperPerDb = 0.11512925464970229;  // of amplitude

// std::floor is a function call where the instruction set is the oldest. What is further away than any place in a
// scene, or no number, comes out as such a far place.
double below(double x) {
    constexpr double far = 1e15;
    const auto whole = static_cast<double>(whole_within<std::int64_t>(x, -far, far));
    return whole - (whole > x);
}

// splitmix64's finaliser over the three indices.
std::uint64_t hash_of(const std::ptrdiff_t brick[3], std::uint64_t seed) {
    std::uint64_t x = (seed + 1) & 0xFFFFFFFFu;
    for (int a = 0; a < 3; ++a) {
        x ^= static_cast<std::uint64_t>(brick[a]) + 0x9E3779B97F4A7C15u + (x << 6);
        x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
        x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
        x ^= x >> 31;
    }
    return x;
}

BeamScope scope_of(const ViewNumbers &p, double slack) {
    return {p.curved != 0, p.apex_mm, p.depth_mm, std::cos(p.half_angle), std::sin(p.half_angle), p.half_width_mm,
            p.beside_mm, p.elevation_mm * p.elevation_mm, p.spread * p.spread, p.focus_mm, p.cut * p.cut, p.cell_mm2,
            p.f_number, p.aperture_mm, slack};
}

double range_of(const BeamScope &b, const Point &at) {
    const double y = at[1] + b.apex;
    return b.curved ? std::sqrt(at[0] * at[0] + y * y) - b.apex : at[1];
}

double variance_at(const BeamScope &b, double away) { return b.variance + b.spread_squared * away * away; }

// Whether an echo displaced by the scope's slack, and `more`, may reach a beam; out of its plane by `across` more.
bool hears(const BeamScope &b, const Point &at, double r, double more, double across) {
    const double slack = b.slack + more;
    if (!(r > -slack - 1 && r < b.depth + slack + 1)) return false;
    const double beside = std::fabs(at[0]) * b.cos - (at[1] + b.apex) * b.sin - b.half_width;
    if (!(beside < slack + b.beside)) return false;
    const double beyond = std::fabs(at[2]) - b.slack - across;  // what the slice's width must make up for
    if (beyond <= 0) return true;
    return beyond * beyond < b.cut_squared * variance_at(b, std::min(std::fabs(r - b.focus) + slack, 2 * b.depth));
}

bool hears(const BeamScope &b, const Point &at, double r, double more = 0) { return hears(b, at, r, more, more); }

// Tissue that one scatterer stands for, mm^3.
double volume_at(const BeamScope &b, double range) {
    const double r = std::clamp(range, 0.0, b.depth);
    return b.cell_mm2 * std::max(b.f_number, r / b.aperture) * std::sqrt(variance_at(b, r - b.focus));
}

}  // namespace

void View::check() const {
    std::array<double, kViewNumbers> numbers;
    std::memcpy(numbers.data(), &probe, sizeof probe);
    require(all_finite(numbers) && all_finite(to_image) && all_finite(to_cell) && all_finite(cell_to_image),
            "probe or an affine map is not finite");
    require(probe.brick_mm > 0 && probe.sample_mm > 0 && probe.line_step > 0,
            "brick_mm, sample_mm or line_step of probe is not above 0");
    require(numbered(shape, 1), "shape has no node along an axis, or too many");
    require_spacing(spacing);
    require(power_count >= 2, "power is shorter than 2");
}

// --- what is heard ---

struct EchoScene::Bricks {
    std::ptrdiff_t first[3], count[3];
    std::ptrdiff_t rows() const { return (count[1] + kRowsPerUnit - 1) / kRowsPerUnit; }
    std::size_t units() const { return static_cast<std::size_t>(count[0] * rows()); }

    // Those around the slice's bounding box, within the scene.
    Bricks(const View &view, const LabelMap &map) {
        const ViewNumbers &p = view.probe;
        const double away = std::max(std::fabs(p.focus_mm), std::fabs(p.depth_mm - p.focus_mm));
        const double thick = p.cut * std::sqrt(p.elevation_mm * p.elevation_mm + p.spread * p.spread * away * away);
        const double side = p.curved != 0 ? (p.depth_mm + p.apex_mm) * std::sin(p.half_angle) : p.half_width_mm;
        const double top = p.apex_mm * (std::cos(p.half_angle) - 1);
        const double m = p.margin_mm + p.beside_mm;
        const double box[3][2] = {{-side - m, side + m}, {top - m, p.depth_mm + m}, {-thick - m, thick + m}};
        double low[3], high[3];
        for (int a = 0; a < 3; ++a) low[a] = std::numeric_limits<double>::infinity(), high[a] = -low[a];
        const Affine34 &t = view.to_image;  // rigid: its inverse is its transpose
        for (int corner = 0; corner < 8; ++corner)
            for (int a = 0; a < 3; ++a) {
                double at = 0;
                for (int b = 0; b < 3; ++b) at += t[4 * b + a] * (box[b][corner >> b & 1] - t[4 * b + 3]);
                low[a] = std::min(low[a], at), high[a] = std::max(high[a], at);
            }
        for (int a = 0; a < 3; ++a) {
            const double half = map.spacing[a] / 2;
            const double end = (static_cast<double>(map.shape[a]) - 1) * map.spacing[a] + half;
            const double from = std::floor(std::max(low[a], -half) / p.brick_mm);
            const double to = std::ceil(std::min(high[a], end) / p.brick_mm);
            require(std::max(std::fabs(from), std::fabs(to)) < kMostNodes, "brick_mm is too small for the scene");
            first[a] = static_cast<std::ptrdiff_t>(from), count[a] = static_cast<std::ptrdiff_t>(to) - first[a];
        }
        if (*std::min_element(count, count + 3) <= 0) count[0] = 0;
    }
};

EchoScene::EchoScene(const EchoTables &tables, const InterfaceNumbers &numbers, double no_echo)
    : tables_(tables), numbers_(numbers), copies_(interface_copies(tables.map, numbers.points_per_mm2)),
      interfaces_(tables.map, tables.impedance, numbers.smoothing, numbers.smallest, numbers.largest,
                  numbers.points_per_mm2) {
    for (int label = 0; label < 256; ++label) {
        const double level = tables.level_db[label];
        amplitude_[label] = level > no_echo ? std::exp(kNeperPerDb * level) : 0;
    }
}

std::vector<const InterfaceBlock *> EchoScene::interfaces() {
    std::vector<std::size_t> all(interfaces_.regions());
    std::iota(all.begin(), all.end(), std::size_t{0});
    return interfaces_.blocks(all);
}

void EchoScene::prepare() {
    for (std::size_t region = 0; region < interfaces_.regions(); region += kRegionsAtOnce) {
        std::vector<std::size_t> some(std::min(kRegionsAtOnce, interfaces_.regions() - region));
        std::iota(some.begin(), some.end(), region);
        interfaces_.blocks(some);
    }
}

// Those that a view may hear.
std::vector<const InterfaceBlock *> EchoScene::surfaces(const View &view) {
    const BeamScope scope = scope_of(view.probe, view.probe.margin_mm);
    const Point half = interfaces_.half();
    double radius = 0, across = 0;  // of a region: a slice is thin
    for (int a = 0; a < 3; ++a) radius += half[a] * half[a], across += std::fabs(view.to_image[8 + a]) * half[a];
    radius = std::sqrt(radius);
    std::vector<std::size_t> near;
    for (std::size_t region = 0; region < interfaces_.regions(); ++region) {
        const Point centre = mapped(view.to_image, interfaces_.centre(region));
        if (hears(scope, centre, range_of(scope, centre), radius, across)) near.push_back(region);
    }
    return interfaces_.blocks(near);
}

// How a label's level departs from its mean at a place (scene lattice mm), as an amplitude.
double EchoScene::texture(int label, const double place[3]) const {
    const auto side = static_cast<double>(tables_.texture_side);
    const std::size_t voxels = tables_.texture_side * tables_.texture_side * tables_.texture_side;
    const float *volume = tables_.texture + voxels * static_cast<std::size_t>(tables_.texture_kind[label]);
    std::size_t low[3], high[3];
    double t[3];
    for (int a = 0; a < 3; ++a) {
        const double *row = tables_.texture_map + 9 * label + 3 * a;
        const double index = place[0] * row[0] + place[1] * row[1] + place[2] * row[2];
        const double at = std::max(0.0, index - side * below(index / side));
        low[a] = whole_within<std::size_t>(at, 0.0, side - 1);
        t[a] = at - static_cast<double>(low[a]);
        high[a] = low[a] + 1 == tables_.texture_side ? 0 : low[a] + 1;
    }
    const auto row = [&](std::size_t i, std::size_t j) {
        const float *from = volume + (i * tables_.texture_side + j) * tables_.texture_side;
        return from[low[2]] + t[2] * (from[high[2]] - static_cast<double>(from[low[2]]));
    };
    const auto face = [&](std::size_t i) {
        const double from = row(i, low[1]);
        return from + t[1] * (row(i, high[1]) - from);
    };
    const double from = face(low[0]), value = from + t[0] * (face(high[0]) - from);
    return std::exp(static_cast<float>(kNeperPerDb * tables_.texture_db[label] * value));
}

void EchoScene::volume(const View &view, const Bricks &bricks, std::size_t unit, Choice::Unit &out) const {
    const BrickKernels &kernel = *kernels().brick;
    const ViewNumbers &p = view.probe;
    const BeamScope scope = scope_of(p, p.margin_mm);
    const LabelMap &map = tables_.map;
    Lattices lattices;
    for (int a = 0; a < 3; ++a)
        lattices.voxels_per_mm[a] = 1 / map.spacing[a], lattices.shape[a] = static_cast<double>(map.shape[a]);
    std::copy(view.to_cell.begin(), view.to_cell.end(), lattices.to_cell);
    alignas(64) double local[3][kMostInBrick], range[kMostInBrick], weight[kMostInBrick];
    alignas(64) std::int64_t voxel[kMostInBrick];
    alignas(64) std::int32_t cell[3][kMostInBrick], place[3][kMostInBrick], number[kMostInBrick];
    std::uint8_t heard[kMostInBrick];
    Brick brick{};
    brick.side = p.brick_mm;
    const auto of_units = static_cast<std::ptrdiff_t>(unit);
    const std::ptrdiff_t row = of_units % bricks.rows() * kRowsPerUnit;
    std::ptrdiff_t at[3] = {bricks.first[0] + of_units / bricks.rows(), 0, 0};
    for (std::ptrdiff_t j = row; j < std::min(bricks.count[1], row + kRowsPerUnit); ++j)
        for (std::ptrdiff_t k = 0; k < bricks.count[2]; ++k) {
            at[1] = bricks.first[1] + j, at[2] = bricks.first[2] + k;
            Point centre;
            for (int a = 0; a < 3; ++a) {
                brick.index[a] = static_cast<double>(at[a]);
                centre[a] = (brick.index[a] + 0.5) * brick.side;
            }
            const Point seen = mapped(view.to_image, centre);
            const double depth = range_of(scope, seen);
            if (!hears(scope, seen, depth, brick.side)) continue;
            const std::uint64_t key = hash_of(at, view.seed);
            const double wanted = brick.side * brick.side * brick.side / volume_at(scope, depth);
            const double chance = static_cast<double>(key >> 40) / 16777216.0;
            brick.count = whole_within<std::size_t>(wanted + chance, 0.0, static_cast<double>(tables_.longest));
            for (std::size_t a = 0; a < 3; ++a) {
                const bool mirrored = key >> (kBrickBits + a) & 1;
                brick.places[a] = tables_.places + (3 * (key & (tables_.patterns - 1)) + a) * tables_.longest;
                brick.flip[a] = mirrored ? 1.0f : 0.0f, brick.sign[a] = mirrored ? -1.0f : 1.0f;
            }
            kernel.place(scope, view.to_image.data(), brick, local, range, heard);
            std::size_t kept = 0;
            for (std::size_t n = 0; n < brick.count; ++n)
                if (heard[n]) {
                    for (int a = 0; a < 3; ++a) local[a][kept] = local[a][n];
                    range[kept] = range[n], number[kept++] = static_cast<std::int32_t>(n);
                }
            kernel.assign(scope, lattices, key, number, kept, local, range, voxel, weight, cell, place);
            const float *signs = tables_.signs + tables_.longest * (key >> (kBrickBits + 3) & (tables_.patterns - 1));
            for (std::size_t i = 0; i < kept; ++i) {
                const int label = voxel[i] < 0 ? 0 : map.labels[voxel[i]];
                if (voxel[i] < 0 || !(amplitude_[label] > 0)) continue;
                double size = signs[number[i]] * amplitude_[label] * weight[i];
                if (tables_.texture_db[label] > 0) {
                    const double here[3] = {local[0][i], local[1][i], local[2][i]};
                    size *= texture(label, here);
                }
                out.add({cell[0][i], cell[1][i], cell[2][i]}, {place[0][i], place[1][i], place[2][i]}, size);
            }
        }
}

/// One echo of a surface: so far along the normal, so strong.
struct EchoScene::Layer {
    double shift, reflection;
};

// A fluid's wall is two layers: where the fluid ends, and where the wall does.
int EchoScene::layers(const InterfacePoint &point, bool walls, Layer out[2]) const {
    out[0] = {0, point.reflection};
    if (!walls) return 1;
    const bool low = tables_.wall_mm[point.low] >= tables_.wall_mm[point.high];
    const double thick = tables_.wall_mm[low ? point.low : point.high];
    const double fluid = tables_.impedance[low ? point.low : point.high], wall = tables_.wall_impedance;
    const double beyond = tables_.impedance[low ? point.high : point.low];
    if (!(thick > 0) || beyond == wall) return 1;
    const auto step = [&](double z) { return std::min(std::fabs(wall - z) / (wall + z), numbers_.largest); };
    out[0] = {0, step(fluid)}, out[1] = {fluid < beyond ? thick : -thick, step(beyond)};
    return 2;
}

// Brighter the squarer the beam meets the surface, undeformed; and where surfaces scatter, as bright from all sides.
void EchoScene::surface(const View &view, const InterfaceBlock &block, std::size_t used, Choice::Unit &out) const {
    const ViewNumbers &p = view.probe;
    const BeamScope scope = scope_of(p, p.margin_mm);
    const Affine34 &m = view.to_image;
    const Point centre = mapped(m, block.centre);
    if (!hears(scope, centre, range_of(scope, centre), block.radius)) return;
    const double last = static_cast<double>(view.power_count - 1);
    const double farthest = p.cut * std::sqrt(variance_at(scope, 2 * p.depth_mm)) + p.margin_mm;
    const double share = static_cast<double>(used) / static_cast<double>(copies_);
    const double gain = numbers_.gain * numbers_.points_per_mm2 / share;
    const auto count = static_cast<std::size_t>(std::nearbyint(static_cast<double>(block.points.size()) * share));
    const auto reflect = [&](const InterfacePoint &point, const Layer &layer) {
        const float *n = point.normal;
        Point local;
        for (int a = 0; a < 3; ++a) local[a] = point.place[a] + layer.shift * n[a];
        const double off_plane = m[8] * local[0] + m[9] * local[1] + m[10] * local[2] + m[11];
        if (std::fabs(off_plane) > farthest) return;
        const Point at = mapped(m, local);
        const double r = range_of(scope, at);
        if (!hears(scope, at, r)) return;
        double along = m[4] * n[0] + m[5] * n[1] + m[6] * n[2];
        if (scope.curved)
            along = ((m[0] * n[0] + m[1] * n[1] + m[2] * n[2]) * at[0] + along * (at[1] + p.apex_mm)) /
                    std::max(r + p.apex_mm, 1e-9);
        const double mirror = gain * layer.reflection * point.area;
        double strength = mirror * std::exp(-numbers_.width * (1 - along * along)), scattered = 0;
        if (view.diffuse) {
            // normals point to the higher impedance
            const bool rises = tables_.impedance[point.low] < tables_.impedance[point.high];
            const bool forwards = rises == (along > 0);
            if (tables_.opaque[forwards ? point.low : point.high] > tables_.opaque[forwards ? point.high : point.low]) return;
            // its sum in a beam, of random signs, stands so far below the mirror's, of one sign
            const double rough = std::max(tables_.rough[point.low], tables_.rough[point.high]);
            const double within = std::clamp(r, 0.0, p.depth_mm);
            const double beam = p.lateral_mm * std::max(p.f_number, within / p.aperture_mm) *
                                std::sqrt(variance_at(scope, within - p.focus_mm));
            scattered = mirror * rough * 2 * std::sqrt(kPi * beam * share / std::max<double>(point.area, 1e-9));
        }
        if (strength + scattered <= p.faintest * numbers_.faintest) return;
        const double sample = std::clamp(r / p.sample_mm, 0.0, last);
        const auto low = static_cast<std::size_t>(std::min(sample, last - 1));
        const double power = view.power[low] + (sample - static_cast<double>(low)) * (view.power[low + 1] - view.power[low]);
        std::array<std::int32_t, 3> cell, place;
        const Point index = mapped(view.to_cell, local);
        for (int a = 0; a < 3; ++a) {
            const double whole = std::clamp(below(index[a]), -kFarCell, kFarCell);
            cell[a] = static_cast<std::int32_t>(whole);
            place[a] = whole_within<std::int32_t>((index[a] - whole) * 65536, 0.0, 65535.0);
        }
        scattered *= point.sign;
        if (!out.add(cell, place, (strength + scattered) * std::sqrt(power)) || !view.diffuse) return;
        Choice::Surface surface;
        for (int a = 0; a < 3; ++a) {
            const double *row = view.to_cell.data() + 4 * a;
            surface.numbers[a] = static_cast<float>((row[0] * n[0] + row[1] * n[1] + row[2] * n[2]) * view.spacing[a] * view.spacing[a]);
        }
        surface.numbers[3] = static_cast<float>(mirror * std::sqrt(power));
        surface.numbers[4] = static_cast<float>(scattered * std::sqrt(power));
        out.surfaces.push_back(surface);
    };
    for (std::size_t i = 0; i < count; ++i) {
        const InterfacePoint &point = block.points[i];
        Layer found[2];
        for (int k = 0, of = layers(point, view.diffuse, found); k < of; ++k) reflect(point, found[k]);
    }
}

Choice EchoScene::choose(const View &view) {
    view.check();
    const Bricks bricks(view, tables_.map);
    const std::vector<const InterfaceBlock *> near = surfaces(view);
    const std::size_t volumes = bricks.units();
    const double wanted = std::ceil(view.probe.points_per_mm2 * largest_face(tables_.map));
    const auto used = static_cast<std::size_t>(std::clamp(wanted, 1.0, static_cast<double>(copies_)));
    std::vector<Choice::Unit> units;
    {
        std::lock_guard<std::mutex> lock(spare_mutex_);
        units.swap(spare_);
    }
    units.resize(volumes + near.size());
    for (Choice::Unit &unit : units) unit.echoes.clear(), unit.surfaces.clear();
    parallel_for(units.size(), [&](std::size_t unit) {
        if (unit < volumes)
            volume(view, bricks, unit, units[unit]);
        else
            surface(view, *near[unit - volumes], used, units[unit]);
    });
    Choice choice;
    choice.sort(std::move(units), view);
    return choice;
}

void EchoScene::reuse(Choice &&choice) {
    std::lock_guard<std::mutex> lock(spare_mutex_);
    spare_ = std::move(choice.units_);
}

}  // namespace sono

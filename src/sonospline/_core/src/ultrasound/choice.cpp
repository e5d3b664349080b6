// Scatterers sorted by the cells of a displacement lattice.
#include <algorithm>
#include <cmath>

#include "common/parallel.hpp"
#include "common/require.hpp"
#include "ultrasound/scatterers.hpp"

namespace sono {
namespace {

constexpr double kFullAmplitude = 32000;
constexpr double kFarStrip = 1e6;
constexpr int kTileSide = 8;                     // cells a side of the table that counts scatterers
constexpr std::int32_t kTileCells = kTileSide * kTileSide * kTileSide;

// Sorts a cell's scatterers by elevation, about: those that lie beside the slice then fill vectors of their own.
class Layers {
  public:
    Layers(std::uint16_t *place, std::int16_t *amplitude, std::size_t stride, float *surfaces, std::size_t surface_stride)
        : place_(place), amplitude_(amplitude), surfaces_(surfaces), stride_(stride), surface_stride_(surface_stride) {}

    /// Of scatterers [first, last), whose surfaces, where they have any, begin at `surface`
    void sort(const CellFrame &frame, std::int32_t first, std::int32_t last, std::int32_t surface) {
        const auto count = static_cast<std::size_t>(last - first);
        if (count < 2) return;
        const float *across = frame.rotation + 3;  // to the image plane
        const auto steeper = [&](std::size_t a, std::size_t b) { return std::fabs(across[b]) > std::fabs(across[a]); };
        std::size_t axis = steeper(0, 1) ? 1 : 0;
        if (steeper(axis, 2)) axis = 2;
        const std::uint16_t *along = place_ + axis * stride_ + first;
        std::size_t next[kLayers + 1] = {};
        for (std::size_t i = 0; i < count; ++i) ++next[along[i] / (65536 / kLayers) + 1];
        for (std::size_t layer = 1; layer < kLayers; ++layer) next[layer + 1] += next[layer];
        to_.resize(count);
        for (std::size_t i = 0; i < count; ++i) to_[i] = next[along[i] / (65536 / kLayers)]++;
        for (std::size_t a = 0; a < 3; ++a) move(place_ + a * stride_ + first, whole_);
        move(amplitude_ + first, level_);
        for (std::size_t k = 0; surface >= 0 && k < kSurfaceFloats; ++k) move(surfaces_ + k * surface_stride_ + surface, number_);
    }

  private:
    static constexpr std::size_t kLayers = 16;

    template <class T> void move(T *values, std::vector<T> &copy) const {
        copy.assign(values, values + to_.size());
        for (std::size_t i = 0; i < to_.size(); ++i) values[to_[i]] = copy[i];
    }

    std::uint16_t *place_;
    std::int16_t *amplitude_;
    float *surfaces_;
    std::size_t stride_, surface_stride_;
    std::vector<std::size_t> to_;
    std::vector<std::uint16_t> whole_;
    std::vector<std::int16_t> level_;
    std::vector<float> number_;
};

}  // namespace

bool Choice::Unit::add(const std::array<std::int32_t, 3> &cell, const std::array<std::int32_t, 3> &place,
                       double amplitude) {
    Echo echo;
    for (int a = 0; a < 3; ++a) {
        echo.cell[a] = static_cast<std::int16_t>(cell[a]);
        if (echo.cell[a] != cell[a]) return false;  // no lattice reaches as far
        echo.place[a] = static_cast<std::uint16_t>(place[a]);
    }
    echo.amplitude = static_cast<float>(amplitude);
    if (!std::isfinite(echo.amplitude)) return false;
    echoes.push_back(echo);
    return true;
}

void Choice::sort(std::vector<Unit> &&units, const View &view) {
    units_ = std::move(units);
    int low[3] = {INT16_MAX, INT16_MAX, INT16_MAX}, high[3] = {INT16_MIN, INT16_MIN, INT16_MIN};
    float largest = 1e-12f;
    std::size_t found = 0;
    for (const Unit &unit : units_) {
        found += unit.echoes.size();
        for (const Echo &echo : unit.echoes) {
            for (int a = 0; a < 3; ++a)
                low[a] = std::min<int>(low[a], echo.cell[a]), high[a] = std::max<int>(high[a], echo.cell[a]);
            largest = std::max(largest, std::fabs(echo.amplitude));
        }
        for (const Surface &surface : unit.surfaces)  // whatever the angle
            largest = std::max(largest, surface.numbers[3] + std::fabs(surface.numbers[4]));
    }
    amplitude_step = static_cast<float>(largest / kFullAmplitude);
    starts = {0}, surface_starts = {0};
    if (low[0] > high[0]) return;
    require(found <= kMostNodes, "the view hears more scatterers than can be numbered");
    // a table of tiles, and of cells in those that hold any: a fine lattice would fill memory with empty cells
    std::size_t tiles[3];
    for (int a = 0; a < 3; ++a) tiles[a] = static_cast<std::size_t>((high[a] - low[a]) / kTileSide + 1);
    require(tiles[0] * tiles[1] * tiles[2] <= kMostNodes, "the lattice is too fine for the scene");
    std::vector<std::int32_t> tile_of(tiles[0] * tiles[1] * tiles[2], -1), counts, surfaces, tile_number;
    for (Unit &unit : units_)
        for (Echo &echo : unit.echoes) {
            const int x = echo.cell[0] - low[0], y = echo.cell[1] - low[1], z = echo.cell[2] - low[2];
            const std::size_t at = (static_cast<std::size_t>(x / kTileSide) * tiles[1] + static_cast<std::size_t>(y / kTileSide)) * tiles[2] +
                                   static_cast<std::size_t>(z / kTileSide);
            std::int32_t &tile = tile_of[at];
            if (tile < 0) {
                require(counts.size() <= kMostNodes - kTileCells, "the lattice is too fine for the scene");
                tile = static_cast<std::int32_t>(counts.size());
                counts.resize(counts.size() + kTileCells), surfaces.resize(counts.size());
                tile_number.push_back(static_cast<std::int32_t>(at));
            }
            echo.slot = tile + (x % kTileSide * kTileSide + y % kTileSide) * kTileSide + z % kTileSide;
            ++counts[static_cast<std::size_t>(echo.slot)];
            if (!unit.surfaces.empty()) ++surfaces[static_cast<std::size_t>(echo.slot)];
        }
    struct Cell {
        int strip;
        float range;
        std::int32_t slot;
        std::size_t found;  // its number before sorting
    };
    std::vector<Cell> cells;
    for (std::size_t slot = 0; slot < counts.size(); ++slot)
        if (counts[slot]) cells.push_back({0, 0, static_cast<std::int32_t>(slot), cells.size()});
    std::vector<CellFrame> frame_of(cells.size());
    std::vector<CellNodes> nodes_of(cells.size());
    const ViewNumbers &p = view.probe;
    const std::ptrdiff_t strides[3] = {static_cast<std::ptrdiff_t>(view.shape[1] * view.shape[2]),
                                       static_cast<std::ptrdiff_t>(view.shape[2]), 1};
    constexpr std::size_t each = 256;
    parallel_for((cells.size() + each - 1) / each, [&](std::size_t block) {
        for (std::size_t i = block * each; i < std::min(cells.size(), (block + 1) * each); ++i) {
            const std::int32_t slot = cells[i].slot, inside = slot % kTileCells;
            const auto tile = static_cast<std::size_t>(tile_number[static_cast<std::size_t>(slot / kTileCells)]);
            const int cell[3] = {low[0] + static_cast<int>(tile / (tiles[1] * tiles[2])) * kTileSide + inside / (kTileSide * kTileSide),
                                 low[1] + static_cast<int>(tile / tiles[2] % tiles[1]) * kTileSide + inside / kTileSide % kTileSide,
                                 low[2] + static_cast<int>(tile % tiles[2]) * kTileSide + inside % kTileSide};
            const Point at = mapped(view.cell_to_image, {double(cell[0]), double(cell[1]), double(cell[2])});
            const double y = at[1] + p.apex_mm, reach = p.curved != 0 ? std::sqrt(at[0] * at[0] + y * y) : at[1];
            const double angle = p.curved != 0 ? std::atan2(at[0], y) : 0, cos = std::cos(angle), sin = std::sin(angle);
            const double range = p.curved != 0 ? reach - p.apex_mm : at[1];
            const double line = (p.curved != 0 ? angle : at[0]) / p.line_step + (p.lines - 1) / 2;
            const double cycles = range * p.cycles_per_mm;
            CellFrame &frame = frame_of[i];
            CellNodes &node = nodes_of[i];
            std::ptrdiff_t first = 0;
            for (int a = 0; a < 3; ++a) {
                const double x = view.cell_to_image[a] / view.spacing[a], d = view.cell_to_image[4 + a] / view.spacing[a];
                // lateral, elevation, axial in image coordinates (x right, y deep, z out of the plane)
                frame.rotation[a] = static_cast<float>(cos * x - sin * d);
                frame.rotation[3 + a] = static_cast<float>(view.cell_to_image[8 + a] / view.spacing[a]);
                frame.rotation[6 + a] = static_cast<float>(sin * x + cos * d);
                const int last = static_cast<int>(view.shape[a]) - 1;
                const int from = std::clamp(cell[a], 0, last), to = std::clamp(cell[a] + 1, 0, last);
                first += from * strides[a];
                node.step[a] = static_cast<std::int32_t>((to - from) * strides[a]);
            }
            node.first = static_cast<std::int32_t>(first);
            frame.range = static_cast<float>(range), frame.line = static_cast<float>(line);
            frame.cycles = static_cast<float>(cycles - std::nearbyint(cycles));
            frame.reach = static_cast<float>(range + p.apex_mm), frame.elevation = static_cast<float>(at[2]);
            frame.unused[0] = frame.unused[1] = 0;
            cells[i].strip = whole_within<int>(std::floor(line / kStripLines), -kFarStrip, kFarStrip);
            cells[i].range = frame.range;
        }
    });
    // strip by strip, and down each: what a strip adds to lies in the first cache
    std::sort(cells.begin(), cells.end(), [](const Cell &a, const Cell &b) {
        return a.strip != b.strip ? a.strip < b.strip : a.range != b.range ? a.range < b.range : a.slot < b.slot;
    });
    rank_.resize(counts.size());
    for (std::size_t rank = 0; rank < cells.size(); ++rank) {
        const auto slot = static_cast<std::size_t>(cells[rank].slot);
        rank_[slot] = static_cast<std::int32_t>(rank);
        frames.push_back(frame_of[cells[rank].found]), nodes.push_back(nodes_of[cells[rank].found]);
        starts.push_back(starts.back() + counts[slot]);
        surface_starts.push_back(surface_starts.back() + surfaces[slot]);
    }
}

void Choice::write(std::uint16_t *place, std::int16_t *amplitude, std::size_t stride, float *surfaces,
                   std::size_t surface_stride) const {
    const auto parts = static_cast<std::size_t>(thread_count());  // each lays out its share of the cells
    const float scale = 1 / amplitude_step;
    std::vector<std::int32_t> next(starts), next_surface(surface_starts);
    parallel_for(parts, [&](std::size_t part) {
        const auto first = static_cast<std::int32_t>(part * frames.size() / parts);
        const auto last = static_cast<std::int32_t>((part + 1) * frames.size() / parts);
        Layers layers(place, amplitude, stride, surfaces, surface_stride);
        for (const Unit &unit : units_)
            for (std::size_t i = 0; i < unit.echoes.size(); ++i) {
                const Echo &echo = unit.echoes[i];
                const std::int32_t rank = rank_[static_cast<std::size_t>(echo.slot)];
                if (rank < first || rank >= last) continue;
                const auto at = static_cast<std::size_t>(next[static_cast<std::size_t>(rank)]++);
                for (int a = 0; a < 3; ++a) place[static_cast<std::size_t>(a) * stride + at] = echo.place[a];
                const float level = echo.amplitude * scale;
                amplitude[at] = static_cast<std::int16_t>(level + (level < 0 ? -0.5f : 0.5f));
                if (unit.surfaces.empty()) continue;
                float *surface = surfaces + next_surface[static_cast<std::size_t>(rank)]++;
                for (std::size_t k = 0; k < kSurfaceFloats; ++k) surface[k * surface_stride] = unit.surfaces[i].numbers[k];
            }
        for (std::int32_t rank = first; rank < last; ++rank) {
            const auto r = static_cast<std::size_t>(rank);
            const std::int32_t on = surface_starts[r + 1] - surface_starts[r];
            layers.sort(frames[r], starts[r], starts[r + 1] - on, -1);
            layers.sort(frames[r], starts[r + 1] - on, starts[r + 1], surface_starts[r]);
        }
    });
    for (std::size_t at = size(); at < size() + kEchoSlack; ++at) {
        for (std::size_t a = 0; a < 3; ++a) place[a * stride + at] = 0;
        amplitude[at] = 0;
    }
    for (std::size_t at = surface_count(); at < surface_stride; ++at)
        for (std::size_t k = 0; k < kSurfaceFloats; ++k) surfaces[k * surface_stride + at] = 0;
}

}  // namespace sono

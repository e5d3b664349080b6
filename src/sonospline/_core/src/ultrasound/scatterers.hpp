// Which scatterers of a scene a probe at a pose may hear, sorted by the cells of a displacement lattice.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <vector>

#include "ultrasound/bmode_kernels.hpp"
#include "ultrasound/interfaces.hpp"

namespace sono {

/// Labels, what they echo, and the shared random patterns; all (256) tables are by label.
struct EchoTables {
    LabelMap map;
    const double *impedance;
    const double *rough;         // amplitude of a surface's diffuse echo over that of its mirror
    const double *wall_mm;       // thickness of the wall around a fluid; 0 where none is
    double wall_impedance;
    const double *opaque;        // not 0 for what no beam leaves again: its surface is not seen from inside
    const double *level_db;      // at no_echo or below: nothing
    const double *texture_db;    // how far the level varies from place to place
    const double *texture_kind;  // which of the textures; a whole number
    const double *texture_map;   // (256, 3, 3) from mm to voxels of a texture
    const float *texture;        // (kinds, side, side, side), periodic
    std::size_t texture_kinds, texture_side;
    const float *places;  // (patterns, 3, longest) in a unit brick
    const float *signs;   // (patterns, longest)
    std::size_t patterns, longest;
};

/// Scalars of a view, in the order in which Python passes them.
struct ViewNumbers {
    double curved, apex_mm, depth_mm, half_angle, half_width_mm, line_step, lines, beside_mm;
    double cycles_per_mm;
    double elevation_mm, spread, focus_mm, cut;  // sigma at the focus, growth, focus, cut in sigmas
    double cell_mm2, f_number, aperture_mm;  // mm^3 a scatterer = cell_mm2 max(f_number, r / aperture) sigma(r)
    double margin_mm, brick_mm, sample_mm;
    double points_per_mm2;                   // on interfaces: at least so many
    double lateral_mm;                       // sigma of the beam over max(f_number, r / aperture)
    double faintest;                         // echo of an interface that is left out, of the scene's own
};
constexpr std::size_t kViewNumbers = 22;
static_assert(sizeof(ViewNumbers) == kViewNumbers * sizeof(double), "as Python passes it");

struct InterfaceNumbers {
    double smoothing, smallest, largest, points_per_mm2, gain, width, faintest;
};

using Affine34 = std::array<double, 12>;
using Point = std::array<double, 3>;

inline Point mapped(const Affine34 &m, const Point &p) {
    Point out;
    for (int a = 0; a < 3; ++a) out[a] = m[4 * a] * p[0] + m[4 * a + 1] * p[1] + m[4 * a + 2] * p[2] + m[4 * a + 3];
    return out;
}

/// A probe at a pose over a displacement lattice.
struct View {
    ViewNumbers probe;
    Affine34 to_image;        // scene lattice mm -> image frame (lateral, depth, elevation)
    Affine34 to_cell;         // scene lattice mm -> cells of the displacement lattice
    Affine34 cell_to_image;   // cells of the displacement lattice -> image frame
    std::array<std::size_t, 3> shape;
    std::array<double, 3> spacing;
    const double *power;      // (power_count) of speckle, by sample
    std::size_t power_count;
    std::uint64_t seed;
    bool diffuse;  // whether surfaces scatter too, have walls, and turn with the tissue

    void check() const;
};

/// Arrays of Cells (bmode_kernels.hpp) but the scatterers themselves, which `write` lays out.
class Choice {
  public:
    std::vector<CellFrame> frames;
    std::vector<CellNodes> nodes;
    std::vector<std::int32_t> starts, surface_starts;
    float amplitude_step = 1;

    std::size_t size() const { return starts.empty() ? 0 : static_cast<std::size_t>(starts.back()); }
    std::size_t surface_count() const { return surface_starts.empty() ? 0 : static_cast<std::size_t>(surface_starts.back()); }
    /// place (3, stride), amplitude (stride), surfaces (kSurfaceFloats, surface_stride): see Surfaces
    void write(std::uint16_t *place, std::int16_t *amplitude, std::size_t stride, float *surfaces,
               std::size_t surface_stride) const;

  private:
    friend class EchoScene;
    struct Echo {
        std::int32_t slot;  // of its cell; while it is found, 0
        std::int16_t cell[3];
        std::uint16_t place[3];
        float amplitude;
    };
    struct Surface {
        float numbers[kSurfaceFloats];
    };
    /// What one block of work finds; where it holds surfaces, one for each echo.
    struct Unit {
        std::vector<Echo> echoes;
        std::vector<Surface> surfaces;
        bool add(const std::array<std::int32_t, 3> &cell, const std::array<std::int32_t, 3> &place, double amplitude);
    };
    void sort(std::vector<Unit> &&, const View &);

    std::vector<Unit> units_;
    std::vector<std::int32_t> rank_;  // of each slot's cell
};

/// Threads may share one.
class EchoScene {
  public:
    EchoScene(const EchoTables &, const InterfaceNumbers &, double no_echo);
    /// All of them.
    std::vector<const InterfaceBlock *> interfaces();
    /// Finds those that no view has asked for yet; other threads' views wait no longer than for a few regions.
    void prepare();
    Choice choose(const View &);
    /// Keeps the memory of a choice for the next one: fresh pages cost as much as the work
    void reuse(Choice &&);

  private:
    struct Bricks;
    void volume(const View &, const Bricks &, std::size_t unit, Choice::Unit &) const;
    std::vector<const InterfaceBlock *> surfaces(const View &);
    void surface(const View &, const InterfaceBlock &, std::size_t used, Choice::Unit &) const;
    struct Layer;
    int layers(const InterfacePoint &, bool walls, Layer out[2]) const;
    double texture(int label, const double place[3]) const;

    const EchoTables tables_;
    const InterfaceNumbers numbers_;
    const std::size_t copies_;
    std::array<double, 256> amplitude_;  // 0 where nothing echoes
    std::mutex spare_mutex_;
    std::vector<Choice::Unit> spare_;
    Interfaces interfaces_;
};

}  // namespace sono

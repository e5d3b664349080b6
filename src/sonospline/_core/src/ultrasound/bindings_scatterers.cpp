#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cstring>
#include <tuple>
#include <utility>
#include <vector>

#include "common/bindings.hpp"
#include "ultrasound/brick_kernels.hpp"
#include "ultrasound/scatterers.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Labels = Array<std::uint8_t, -1, -1, -1>;
using PerLabel = Array<double, 256>;
using Maps = Array<double, 256, 3, 3>;
using Volumes = Array<float, -1, -1, -1, -1>;
using Places = Array<float, -1, 3, -1>;
using Table = Array<float, -1, -1>;
using Affine34 = Array<double, 3, 4>;

sono::Affine34 affine(const Affine34 &m) {
    sono::Affine34 out;
    std::copy_n(m.data(), out.size(), out.begin());
    return out;
}

// Holds the arrays that the scene points into. They are its own from then on. Threads may share one.
class EchoScene {
  public:
    EchoScene(const Labels &labels, const std::array<double, 3> &spacing, const PerLabel &impedance,
              const PerLabel &rough, const PerLabel &wall_mm, double wall_impedance, const PerLabel &opaque, const PerLabel &level_db, const PerLabel &texture_db, const PerLabel &texture_kind, const Maps &texture_map,
              const Volumes &texture, const Places &places, const Table &signs, const std::array<double, 7> &interfaces, double no_echo)
        : labels_(labels), impedance_(impedance), rough_(rough), wall_(wall_mm), wall_impedance_(wall_impedance), opaque_(opaque), level_(level_db), texture_db_(texture_db), kind_(texture_kind), map_(texture_map),
          texture_(texture), places_(places), signs_(signs), scene_(tables(spacing), numbers(interfaces), no_echo) {}

    auto interfaces() {
        const std::vector<const sono::InterfaceBlock *> blocks = [&] {
            const Outside outside;
            return scene_.interfaces();
        }();
        std::size_t count = 0;
        for (const auto *block : blocks) count += block->points.size();
        auto place = new_array<float, 2>({count, 3}), normal = new_array<float, 2>({count, 3});
        auto reflection = new_array<float, 1>({count}), area = new_array<float, 1>({count});
        std::size_t at = 0;
        for (const auto *block : blocks)
            for (const sono::InterfacePoint &point : block->points) {
                std::copy_n(point.place, 3, place.data() + 3 * at);
                std::copy_n(point.normal, 3, normal.data() + 3 * at);
                reflection.data()[at] = point.reflection, area.data()[at++] = point.area;
            }
        return std::tuple(place, normal, reflection, area);
    }

    void prepare() { scene_.prepare(); }

    auto choose(const std::array<double, sono::kViewNumbers> &probe, const Affine34 &to_image, const Affine34 &to_cell,
                const Affine34 &cell_to_image, const std::array<std::size_t, 3> &shape,
                const std::array<double, 3> &spacing, const Array<double, -1> &power, std::uint64_t seed, bool diffuse) {
        sono::View view{{},    affine(to_image), affine(to_cell),  affine(cell_to_image), shape, spacing,
                        power.data(), power.shape(0), seed, diffuse};
        std::memcpy(&view.probe, probe.data(), sizeof view.probe);
        sono::Choice choice = [&] {
            const Outside outside;
            return scene_.choose(view);
        }();
        const std::size_t cells = choice.frames.size(), stride = choice.size() + sono::kEchoSlack;
        auto frames = new_array<float, 2>({cells, sono::kFrameFloats});
        auto nodes = new_array<std::int32_t, 2>({cells, 4});
        auto starts = new_array<std::int32_t, 1>({cells + 1});
        auto place = new_array<std::uint16_t, 2>({3, stride});
        auto amplitude = new_array<std::int16_t, 1>({stride});
        const std::size_t surface_stride = choice.surface_count() + sono::kEchoSlack;
        auto surface_starts = new_array<std::int32_t, 1>({cells + 1});
        auto surfaces = new_array<float, 2>({sono::kSurfaceFloats, surface_stride});
        {
            const Outside outside;
            choice.write(place.data(), amplitude.data(), stride, surfaces.data(), surface_stride);
            if (cells) {  // of nothing there is no address
                std::memcpy(frames.data(), choice.frames.data(), cells * sizeof(sono::CellFrame));
                std::memcpy(nodes.data(), choice.nodes.data(), cells * sizeof(sono::CellNodes));
            }
            std::copy(choice.starts.begin(), choice.starts.end(), starts.data());
            std::copy(choice.surface_starts.begin(), choice.surface_starts.end(), surface_starts.data());
        }
        const float amplitude_step = choice.amplitude_step;
        scene_.reuse(std::move(choice));
        return std::tuple(frames, nodes, starts, place, amplitude, amplitude_step, surface_starts, surfaces);
    }

  private:
    sono::EchoTables tables(const std::array<double, 3> &spacing) const {
        const std::size_t kinds = texture_.shape(0), side = texture_.shape(1), patterns = places_.shape(0);
        const auto shape = lattice_of(labels_);
        require(*std::max_element(shape.begin(), shape.end()) <= sono::kMostAlongAxis, "labels has too long an axis");
        sono::require_spacing(spacing);
        require(side >= 2 && texture_.shape(2) == side && texture_.shape(3) == side, "texture is no cubes of 2 or more");
        require(std::all_of(kind_.data(), kind_.data() + kind_.size(),
                            [=](double kind) { return kind >= 0 && kind < static_cast<double>(kinds); }),
                "texture_kind has a number that is no texture's");
        require(patterns > 0 && (patterns & (patterns - 1)) == 0 && signs_.shape(0) == patterns &&
                    signs_.shape(1) == places_.shape(2),
                "places and signs differ in length, or are no power of two");
        require(signs_.shape(1) <= sono::kMostInBrick, "signs has more than 512 columns");
        return {{labels_.data(), shape, spacing},
                impedance_.data(), rough_.data(), wall_.data(), wall_impedance_, opaque_.data(), level_.data(), texture_db_.data(), kind_.data(), map_.data(), texture_.data(), kinds, side,
                places_.data(), signs_.data(), patterns, places_.shape(2)};
    }
    static sono::InterfaceNumbers numbers(const std::array<double, 7> &n) {
        require(sono::all_finite(n) && n[0] > 0 && n[0] <= 64 && n[3] >= 0,
                "interfaces is not finite, or smoothing not between 0 and 64 voxels, or points_per_mm2 below 0");
        return {n[0], n[1], n[2], n[3], n[4], n[5], n[6]};
    }

    Labels labels_;
    PerLabel impedance_, rough_, wall_;
    double wall_impedance_;
    PerLabel opaque_, level_, texture_db_, kind_;
    Maps map_;
    Volumes texture_;
    Places places_;
    Table signs_;
    sono::EchoScene scene_;
};

}  // namespace

void bind_scatterers(nb::module_ &m) {
    nb::class_<EchoScene>(m, "EchoScene")
        .def(nb::init<const Labels &, const std::array<double, 3> &, const PerLabel &, const PerLabel &,
                      const PerLabel &, double, const PerLabel &, const PerLabel &, const PerLabel &, const PerLabel &, const Maps &, const Volumes &, const Places &, const Table &,
                      const std::array<double, 7> &, double>(),
             "labels"_a, "spacing"_a, "impedance"_a, "rough"_a, "wall_mm"_a, "wall_impedance"_a, "opaque"_a, "level_db"_a, "texture_db"_a, "texture_kind"_a, "texture_map"_a, "texture"_a,
             "places"_a, "signs"_a, "interfaces"_a, "no_echo"_a)
        .def("interfaces", &EchoScene::interfaces)
        .def("prepare", &EchoScene::prepare, nb::call_guard<Outside>())
        .def("choose", &EchoScene::choose, "probe"_a, "to_image"_a, "to_cell"_a, "cell_to_image"_a, "shape"_a,
             "spacing"_a, "power"_a, "seed"_a, "diffuse"_a);
}

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <mutex>
#include <optional>
#include <tuple>

#include "common/bindings.hpp"
#include "ultrasound/bmode.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Vector = Array<float, -1>;
using Table = Array<float, -1, -1>;
using Indices = Array<std::int32_t, -1>;
using Picture = Array<std::int32_t, -1, -1>;
using Fractions = Array<std::uint8_t, -1, -1, 2>;
using Nodes = Array<std::int32_t, -1, 4>;
using Places = Array<std::uint16_t, 3, -1>;
using Amplitudes = Array<std::int16_t, -1>;
using Labels = Array<std::uint8_t, -1, -1, -1>;
using PerLabel = Array<float, 256>;
using Beams = Array<float, -1, -1, 2>;

// The arrays that an aim points into. They are the plan's from then on: whoever changes one changes what is checked.
struct Aimed {
    Table frames;
    Nodes nodes;
    Indices starts;
    Places place;
    Amplitudes amplitude;
    float amplitude_step;
    Rows ray_start, ray_step;
    Labels labels;
    Array<double, 3, 4> label_index;
    PerLabel loss_db, impedance;
    Indices surface_starts;
    Table surfaces;
    float surface_width;

    void check(std::size_t rays) const {
        const std::size_t count = nodes.shape(0);
        require(frames.shape(0) == count && frames.shape(1) == sono::kFrameFloats && starts.shape(0) == count + 1,
                "frames is not (cells, 16), or nodes and starts are not for as many cells");
        const std::int32_t *const first = starts.data(), *const last = first + count;
        require(*first >= 0 && std::is_sorted(first, last + 1), "starts falls, or begins below 0");
        const std::size_t echoes = static_cast<std::size_t>(*last) + sono::kEchoSlack;
        require(place.shape(1) == amplitude.shape(0) && amplitude.shape(0) >= echoes,
                "place and amplitude do not reach 64 beyond the last scatterer, or differ in length");
        const std::int32_t *const surface = surface_starts.data();
        require(surface_starts.shape(0) == count + 1 && *surface == 0, "surface_starts is not (cells + 1), from 0");
        for (std::size_t cell = 0; cell < count; ++cell)
            require(surface[cell] <= surface[cell + 1] && surface[cell + 1] - surface[cell] <= first[cell + 1] - first[cell],
                    "surface_starts falls, or counts more than starts in a cell");
        require(surfaces.shape(0) == sono::kSurfaceFloats &&
                    surfaces.shape(1) >= static_cast<std::size_t>(surface[count]) + sono::kEchoSlack,
                "surfaces is not (5, n), or does not reach 64 beyond the last");
        require(surface_width >= 0 && surface_width <= 9, "surface_width is not between 0 and 9");
        require(ray_start.shape(0) == rays && ray_step.shape(0) == rays, "ray_start or ray_step is not (rays, 3)");
        const auto shape = lattice_of(labels);
        require(*std::max_element(shape.begin(), shape.end()) <= sono::kMostAlongAxis, "labels has too long an axis");
    }

    // How many nodes a lattice must have for all cells to lie in it.
    std::size_t lattice_nodes() const {
        std::int64_t most = -1;
        const std::int32_t *node = nodes.data();
        for (std::size_t cell = 0; cell < nodes.shape(0); ++cell, node += 4) {
            require(*std::min_element(node, node + 4) >= 0, "nodes has a number below 0");
            most = std::max(most, std::int64_t(node[0]) + node[1] + node[2] + node[3]);
        }
        return static_cast<std::size_t>(most + 1);
    }

    sono::Aim aim() const {
        sono::Aim aim{};
        const std::size_t stride = place.shape(1);
        aim.cells = {reinterpret_cast<const sono::CellFrame *>(frames.data()),
                     reinterpret_cast<const sono::CellNodes *>(nodes.data()),
                     starts.data(),
                     place.data(),
                     place.data() + stride,
                     place.data() + 2 * stride,
                     amplitude.data(),
                     amplitude_step,
                     nodes.shape(0)};
        const float *numbers = surfaces.data();
        const std::size_t each = surfaces.shape(1);
        aim.surfaces = {surface_starts.data(), {numbers, numbers + each, numbers + 2 * each}, numbers + 3 * each,
                        numbers + 4 * each, surface_width};
        aim.ray_start = ray_start.data(), aim.ray_step = ray_step.data(), aim.labels = labels.data();
        for (int a = 0; a < 3; ++a) aim.label_shape[a] = labels.shape(a);
        std::copy_n(label_index.data(), 12, aim.label_index);
        aim.loss_db = loss_db.data(), aim.impedance = impedance.data();
        return aim;
    }
};

// Holds the arrays that the renderer points into. Threads may share one: a frame has its scratch memory alone.
class BmodePlan {
  public:
    BmodePlan(const std::array<double, 10> &geometry, bool curved, int lines, int samples, const Vector &axial,
              const Table &lateral, int rays, int ray_samples, const Indices &smoothing_first, const Table &smoothing,
              const Picture &pixel, const Fractions &fraction)
        : axial_(axial), lateral_(lateral), first_(smoothing_first), smoothing_(smoothing), pixel_(pixel),
          fraction_(fraction), renderer_(tables(geometry, curved, lines, samples, rays, ray_samples)) {}

    void aim(const Table &frames, const Nodes &nodes, const Indices &starts, const Places &place,
             const Amplitudes &amplitude, float amplitude_step, const Rows &ray_start, const Rows &ray_step,
             const Labels &labels, const Array<double, 3, 4> &label_index, const PerLabel &loss_db,
             const PerLabel &impedance, const Indices &surface_starts, const Table &surfaces, float surface_width) {
        std::optional<Aimed> next = Aimed{frames,   nodes,  starts,      place,   amplitude, amplitude_step, ray_start,
                                          ray_step, labels, label_index, loss_db, impedance, surface_starts, surfaces, surface_width};
        next->check(static_cast<std::size_t>(rays_));
        const std::size_t lattice_nodes = next->lattice_nodes();
        {
            const Outside outside;
            const std::lock_guard<std::mutex> lock(mutex_);
            aimed_.swap(next);  // the old arrays end with `next`, which takes Python's lock
            lattice_nodes_ = lattice_nodes;
        }
    }

    auto render(const Array<float, -1, -1, -1, 3> &values, const std::array<double, 3> &spacing,
                const Array<float, -1, 4> &echoes, const Table &shadow, float shadow_soft_mm, const Vector &noise,
                float noise_level, const Vector &offset_db, float range_db, const Beams &wide, const Vector &wide_scale,
                const Beams &haze, const Beams &texture, float tail_level, float tail_keep, const Table &ghosts,
                const Vector &unit, const Vector &loudness, float again) {
        const std::size_t lines = static_cast<std::size_t>(lines_), samples = static_cast<std::size_t>(samples_);
        const auto shape = lattice_of(values);
        require(sono::numbered(shape, 2), "values has fewer than 2 nodes along an axis, or too many");
        sono::require_spacing(spacing);
        require(noise.shape(0) >= 2 * lines * samples, "noise is shorter than 2 lines samples");
        require(shadow.shape(0) == 2 && shadow.shape(1) == lines && offset_db.shape(0) == samples,
                "shadow is not (2, lines), or offset_db not (samples)");
        require(wide.shape(0) == 0 || (wide.shape(0) >= 2 && wide.shape(1) == samples && wide_scale.shape(0) == samples),
                "wide is not (2 or more lines, samples, 2), or wide_scale not (samples)");
        require(haze.shape(0) == 0 || (haze.shape(0) == lines && haze.shape(1) <= samples),
                "haze is not (lines, at most samples, 2)");
        require(texture.shape(0) == 0 || (texture.shape(0) == lines && texture.shape(1) == samples),
                "texture is not (lines, samples, 2)");
        require(tail_level >= 0 && tail_keep >= 0 && tail_keep < 1, "tail_level is below 0, or tail_keep not 0 to 1");
        require(ghosts.shape(0) == 0 || (ghosts.shape(0) == lines && ghosts.shape(1) == samples / sono::kTailRun),
                "ghosts is not (lines, samples / 16)");
        require(again == 0 || (again > 0 && unit.shape(0) == samples && loudness.shape(0) == samples),
                "again is below 0, or unit or loudness not (samples)");
        const sono::FrameInput in{{values.data(), shape, spacing, 1},
                                  echoes.data(), echoes.shape(0), shadow.data(), shadow_soft_mm,
                                  noise.data(), noise_level, offset_db.data(), range_db,
                                  {wide.data(), wide.shape(0), wide_scale.data(), haze.data(),
                                   haze.shape(0) ? haze.shape(1) : 0, texture.shape(0) ? texture.data() : nullptr,
                                   tail_level, tail_keep, ghosts.shape(0) ? ghosts.data() : nullptr, unit.data(),
                                   loudness.data(), again}};
        auto iq = new_array<float, 3>({lines, samples, 2});
        auto grey = new_array<std::uint8_t, 2>({lines, samples});
        auto picture = new_array<std::uint8_t, 2>({pixel_.shape(0), pixel_.shape(1)});
        {
            const Outside outside;
            const std::lock_guard<std::mutex> lock(mutex_);
            require(aimed_.has_value(), "aim first");
            require(shape[0] * shape[1] * shape[2] >= lattice_nodes_, "values has fewer nodes than the aim's lattice");
            renderer_.render(aimed_->aim(), in, {iq.data(), grey.data(), picture.data()});
        }
        return std::tuple(iq, grey, picture);
    }

  private:
    sono::ProbeTables tables(const std::array<double, 10> &g, bool curved, int lines, int samples, int rays,
                             int ray_samples) {
        const auto f = [&](int i) { return static_cast<float>(g[i]); };
        lines_ = lines, samples_ = samples, rays_ = rays;
        require(sono::all_finite(g), "geometry is not finite");
        require(lines >= 2 && lines <= INT16_MAX, "lines is not between 2 and 32767");
        require(samples >= 16 && samples % 16 == 0 && samples <= kMostSamples / lines,
                "samples is not a multiple of 16, or too many");
        require(axial_.shape(0) % 2 == 1 && axial_.shape(0) < 2 * sono::kBinPad, "axial has a wrong length");
        require(lateral_.shape(0) % 2 == 1 && lateral_.shape(0) <= kMostTaps &&
                    lateral_.shape(1) == static_cast<std::size_t>(samples),
                "lateral has a wrong shape");
        require(rays >= 1 && ray_samples >= 16 && ray_samples % 16 == 0 && ray_samples <= kMostSamples / rays,
                "ray_samples is not a multiple of 16, or rays or ray_samples too many");
        require(smoothing_.shape(0) == static_cast<std::size_t>(lines) && first_.shape(0) == smoothing_.shape(0) &&
                    smoothing_.shape(1) <= static_cast<std::size_t>(rays),
                "smoothing is not (lines, taps), or smoothing_first not (lines)");
        const auto last = static_cast<std::int32_t>(static_cast<std::size_t>(rays) - smoothing_.shape(1));
        require(std::all_of(first_.data(), first_.data() + lines, [=](auto ray) { return ray >= 0 && ray <= last; }),
                "smoothing_first has a ray that is none");
        require(pixel_.size() && pixel_.shape(0) == fraction_.shape(0) && pixel_.shape(1) == fraction_.shape(1),
                "pixel is empty, or fraction not of its shape");
        const std::int32_t corner = (lines - 1) * samples - 2;  // the last with three neighbours
        require(*std::max_element(pixel_.data(), pixel_.data() + pixel_.size()) <= corner,
                "pixel has a sample beyond the last but one, of the last line but one");
        sono::ProbeTables t{};
        t.beam = {curved, f(0), f(1), f(2), f(3), f(4), f(5), f(6), f(7), f(8), f(9), lines, samples};
        t.axial_half = static_cast<int>(axial_.shape(0) / 2), t.axial = axial_.data();
        t.lateral_half = static_cast<int>(lateral_.shape(0) / 2), t.lateral = lateral_.data();
        t.rays = rays, t.ray_samples = ray_samples;
        t.smoothing_taps = static_cast<int>(smoothing_.shape(1)), t.smoothing_first = first_.data();
        t.smoothing = smoothing_.data();
        t.rows = pixel_.shape(0), t.columns = pixel_.shape(1);
        t.pixel = pixel_.data(), t.fraction = fraction_.data();
        return t;
    }

    static constexpr int kMostSamples = 1 << 26;  // of all lines: offsets among their half-samples fit 32 bits
    static constexpr std::size_t kMostTaps = 1 << 16;

    Vector axial_;
    Table lateral_;
    Indices first_;
    Table smoothing_;
    Picture pixel_;
    Fractions fraction_;
    int lines_ = 0, samples_ = 0, rays_ = 0;
    std::mutex mutex_;
    sono::BmodeRenderer renderer_;
    std::optional<Aimed> aimed_;
    std::size_t lattice_nodes_ = 0;  // that it needs
};

}  // namespace

void bind_bmode(nb::module_ &m) {
    nb::class_<BmodePlan>(m, "BmodePlan")
        .def(nb::init<const std::array<double, 10> &, bool, int, int, const Vector &, const Table &, int, int,
                      const Indices &, const Table &, const Picture &, const Fractions &>(),
             "geometry"_a, "curved"_a, "lines"_a, "samples"_a, "axial"_a, "lateral"_a, "rays"_a, "ray_samples"_a,
             "smoothing_first"_a, "smoothing"_a, "pixel"_a, "fraction"_a)
        .def("aim", &BmodePlan::aim, "frames"_a, "nodes"_a, "starts"_a, "place"_a, "amplitude"_a, "amplitude_step"_a,
             "ray_start"_a, "ray_step"_a, "labels"_a, "label_index"_a, "loss_db"_a, "impedance"_a,
             "surface_starts"_a, "surfaces"_a, "surface_width"_a)
        .def("render", &BmodePlan::render, "values"_a, "spacing"_a, "echoes"_a, "shadow"_a, "shadow_soft_mm"_a,
             "noise"_a, "noise_level"_a, "offset_db"_a, "range_db"_a, "wide"_a, "wide_scale"_a, "haze"_a, "texture"_a,
             "tail_level"_a, "tail_keep"_a, "ghosts"_a, "unit"_a, "loudness"_a, "again"_a);
}

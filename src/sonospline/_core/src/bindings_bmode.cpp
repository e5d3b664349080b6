#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <mutex>
#include <tuple>

#include "bindings.hpp"
#include "bmode.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <class T, class Shape> using Array = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Vector = Array<float, nb::shape<-1>>;
using Table = Array<float, nb::shape<-1, -1>>;
using Indices = Array<std::int32_t, nb::shape<-1>>;
using Picture = Array<std::int32_t, nb::shape<-1, -1>>;
using Fractions = Array<std::uint8_t, nb::shape<-1, -1, 2>>;

void require(bool met, const char *what) {
    if (!met) throw nb::value_error(what);
}

// Holds the arrays that the renderer points into.
class BmodePlan {
  public:
    BmodePlan(const std::array<double, 10> &geometry, bool curved, int lines, int samples, Vector axial, Table lateral,
              int rays, int ray_samples, Indices smoothing_first, Table smoothing, Picture pixel, Fractions fraction)
        : axial_(axial), lateral_(lateral), first_(smoothing_first), smoothing_(smoothing), pixel_(pixel),
          fraction_(fraction), renderer_(tables(geometry, curved, lines, samples, rays, ray_samples)) {}

    void aim(Table frames, Array<std::int32_t, nb::shape<-1, 4>> nodes, Indices starts,
             Array<std::uint16_t, nb::shape<3, -1>> place, Array<std::int16_t, nb::shape<-1>> amplitude,
             float amplitude_step, Array<double, nb::shape<-1, 3>> ray_start, Array<double, nb::shape<-1, 3>> ray_step,
             Array<std::uint8_t, nb::shape<-1, -1, -1>> labels, Array<double, nb::shape<3, 4>> label_index,
             Array<float, nb::shape<256>> loss_db, Array<float, nb::shape<256>> impedance) {
        const std::size_t count = nodes.shape(0);
        require(frames.shape(0) == count && frames.shape(1) == sono::kFrameFloats && starts.shape(0) == count + 1,
                "frames, nodes and starts differ in length");
        const std::size_t echoes = static_cast<std::size_t>(starts.data()[count]) + sono::kEchoSlack;
        require(place.shape(1) == amplitude.shape(0) && amplitude.shape(0) >= echoes, "place lacks its slack");
        std::lock_guard<std::mutex> lock(mutex_);
        frames_ = frames, nodes_ = nodes, starts_ = starts, place_ = place, amplitude_ = amplitude;
        start_ = ray_start, step_ = ray_step, labels_ = labels, loss_ = loss_db, impedance_ = impedance;
        aim_.cells = {reinterpret_cast<const sono::CellFrame *>(frames.data()),
                      reinterpret_cast<const sono::CellNodes *>(nodes.data()),
                      starts.data(),
                      place.data(),
                      place.data() + place.shape(1),
                      place.data() + 2 * place.shape(1),
                      amplitude.data(),
                      amplitude_step,
                      count};
        aim_.ray_start = ray_start.data(), aim_.ray_step = ray_step.data(), aim_.labels = labels.data();
        for (int a = 0; a < 3; ++a) aim_.label_shape[a] = labels.shape(a);
        std::copy_n(label_index.data(), 12, aim_.label_index);
        aim_.loss_db = loss_db.data(), aim_.impedance = impedance.data();
    }

    auto render(Array<float, nb::shape<-1, -1, -1, 3>> values, const std::array<double, 3> &spacing,
                Array<float, nb::shape<-1, 4>> echoes, Table shadow, float shadow_soft_mm, Vector noise,
                float noise_level, Vector offset_db, float range_db) {
        const std::size_t lines = static_cast<std::size_t>(lines_), samples = static_cast<std::size_t>(samples_);
        require(noise.shape(0) >= 2 * lines * samples, "noise is too short");
        require(shadow.shape(0) == 2 && shadow.shape(1) == lines && offset_db.shape(0) == samples,
                "shadow or offset_db has the wrong length");
        require(aim_.cells.count == 0 || nodes_.is_valid(), "aim first");
        const sono::FrameInput in{{values.data(), {values.shape(0), values.shape(1), values.shape(2)}, spacing},
                                  echoes.data(), echoes.shape(0), shadow.data(), shadow_soft_mm,
                                  noise.data(), noise_level, offset_db.data(), range_db};
        auto iq = new_array<float, 3>({lines, samples, 2});
        auto grey = new_array<std::uint8_t, 2>({lines, samples});
        auto picture = new_array<std::uint8_t, 2>({pixel_.shape(0), pixel_.shape(1)});
        {
            const Outside outside;
            std::lock_guard<std::mutex> lock(mutex_);
            renderer_.render(aim_, in, {iq.data(), grey.data(), picture.data()});
        }
        return std::tuple(iq, grey, picture);
    }

  private:
    sono::ProbeTables tables(const std::array<double, 10> &g, bool curved, int lines, int samples, int rays,
                             int ray_samples) {
        const auto f = [&](int i) { return static_cast<float>(g[i]); };
        lines_ = lines, samples_ = samples;
        require(samples % 16 == 0, "samples is not a multiple of 16");
        require(axial_.shape(0) % 2 == 1 && axial_.shape(0) < 2 * sono::kBinPad, "axial has a wrong length");
        require(lateral_.shape(0) % 2 == 1 && lateral_.shape(1) == static_cast<std::size_t>(samples),
                "lateral has a wrong shape");
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

    std::mutex mutex_;  // scratch memory serves one frame at a time
    Vector axial_;
    Table lateral_;
    Indices first_;
    Table smoothing_;
    Picture pixel_;
    Fractions fraction_;
    int lines_ = 0, samples_ = 0;
    sono::BmodeRenderer renderer_;
    Table frames_;
    Array<std::int32_t, nb::shape<-1, 4>> nodes_;
    Indices starts_;
    Array<std::uint16_t, nb::shape<3, -1>> place_;
    Array<std::int16_t, nb::shape<-1>> amplitude_;
    Array<double, nb::shape<-1, 3>> start_, step_;
    Array<std::uint8_t, nb::shape<-1, -1, -1>> labels_;
    Array<float, nb::shape<256>> loss_, impedance_;
    sono::Aim aim_{};
};

}  // namespace

void bind_bmode(nb::module_ &m) {
    nb::class_<BmodePlan>(m, "BmodePlan")
        .def(nb::init<const std::array<double, 10> &, bool, int, int, Vector, Table, int, int, Indices, Table, Picture,
                      Fractions>(),
             "geometry"_a, "curved"_a, "lines"_a, "samples"_a, "axial"_a, "lateral"_a, "rays"_a, "ray_samples"_a,
             "smoothing_first"_a, "smoothing"_a, "pixel"_a, "fraction"_a)
        .def("aim", &BmodePlan::aim, "frames"_a, "nodes"_a, "starts"_a, "place"_a, "amplitude"_a, "amplitude_step"_a,
             "ray_start"_a, "ray_step"_a, "labels"_a, "label_index"_a, "loss_db"_a, "impedance"_a)
        .def("render", &BmodePlan::render, "values"_a, "spacing"_a, "echoes"_a, "shadow"_a, "shadow_soft_mm"_a,
             "noise"_a, "noise_level"_a, "offset_db"_a, "range_db"_a);
}

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "bindings.hpp"
#include "reslice.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <class T, class Shape> using Array = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Values = Array<float, nb::shape<-1, -1, -1, 3>>;

auto reslice(Values values, const std::array<double, 3> &spacing, Array<double, nb::shape<3, 3>> pixel,
             Array<float, nb::shape<-1, -1, -1>> voxels, std::optional<Array<std::uint8_t, nb::shape<-1, -1, -1>>> seen,
             Array<double, nb::shape<3, 4>> index, const std::array<std::size_t, 2> &shape, double tolerance,
             int most) {
    const sono::LatticeField field{values.data(), {values.shape(0), values.shape(1), values.shape(2)}, spacing};
    const sono::VoxelImage image{voxels.data(), seen ? seen->data() : nullptr, {voxels.shape(0), voxels.shape(1), voxels.shape(2)}};
    sono::PixelPlane plane;
    std::copy_n(pixel.data(), 9, plane.pixel);
    std::copy_n(index.data(), 12, plane.index);
    plane.rows = shape[0], plane.columns = shape[1];
    auto grey = new_array<float, 2>({shape[0], shape[1]});
    auto mask = new_array<std::uint8_t, 2>({shape[0], shape[1]});
    {
        const Outside outside;
        sono::reslice(field, image, plane, tolerance, most, grey.data(), mask.data());
    }
    return std::pair(grey, mask);
}

}  // namespace

void bind_reslice(nb::module_ &m) {
    m.def("reslice", &reslice, "values"_a, "spacing"_a, "pixel"_a, "voxels"_a, "seen"_a.none(), "index"_a, "shape"_a,
          "tolerance"_a, "most"_a);
}

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "common/bindings.hpp"
#include "ultrasound/reslice.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using sono::require;

namespace {

using Values = Array<float, -1, -1, -1, 3>;
using Voxels = Array<float, -1, -1, -1>;
using Seen = Array<std::uint8_t, -1, -1, -1>;

auto reslice(const Values &values, const std::array<double, 3> &spacing, const Array<double, 3, 3> &pixel,
             const Voxels &voxels, const std::optional<Seen> &seen, const Array<double, 3, 4> &index,
             const std::array<std::size_t, 2> &shape, double tolerance, int most) {
    require(sono::numbered(lattice_of(values), 2), "values has fewer than 2 nodes along an axis, or too many");
    sono::require_spacing(spacing);
    const auto image_shape = lattice_of(voxels);
    require(*std::min_element(image_shape.begin(), image_shape.end()) >= 1 &&
                *std::max_element(image_shape.begin(), image_shape.end()) <= sono::kMostAlongAxis,
            "voxels is empty, or has too long an axis");
    require(!seen || lattice_of(*seen) == image_shape, "seen is not of the shape of voxels");
    require(std::max(shape[0], shape[1]) <= sono::kMostAlongAxis, "shape has too long a side");
    require(most >= 0 && most <= 10'000, "most is not between 0 and 10000");
    const sono::LatticeField field{values.data(), lattice_of(values), spacing, 1};
    const sono::VoxelImage image{voxels.data(), seen ? seen->data() : nullptr, image_shape};
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

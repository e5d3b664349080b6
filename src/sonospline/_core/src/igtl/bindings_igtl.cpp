// Python side of OpenIGTLink; its NumPy twin has the documentation.
#include "common/bindings.hpp"

#include "igtl/crc64.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

std::uint64_t crc64(const Array<std::uint8_t, -1> &data, std::uint64_t start) {
    const Outside outside;
    return sono::crc64(data.data(), data.size(), start);
}

}  // namespace

void bind_igtl(nb::module_ &m) { m.def("crc64", &crc64, "data"_a, "start"_a); }

// What the files that bind parts of the core share. Every array is checked before a pointer to it is taken: its type,
// layout and number of axes here, which makes a TypeError of them, the rest by `require`.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/buffers.hpp"
#include "common/gil.hpp"
#include "common/require.hpp"

/// "float64", "uint8" and so on.
template <class T> std::string name_of_type() {
    const char *kind = std::is_floating_point_v<T> ? "float" : std::is_signed_v<T> ? "int" : "uint";
    return kind + std::to_string(8 * sizeof(T));
}

/// A NumPy array as a new one of a type, in C order; null where the type would lose its meaning, as whole numbers would
/// of fractions.
inline PyObject *converted(PyObject *array, const char *type) noexcept {
    PyObject *const copy =
        while_python_lives([&] { return PyObject_CallMethod(array, "astype", "sss", type, "C", "same_kind"); });
    if (!copy) PyErr_Clear();
    return copy;
}

/// An array in C order whose elements are aligned. One that is only read may be converted first; one that is written to
/// may not: what was written to a copy would be lost.
template <class NdArray> class Checked : public NdArray {
  public:
    Checked() = default;
    explicit Checked(NdArray &&array) : NdArray(std::move(array)) {}
};

template <class NdArray> struct nanobind::detail::type_caster<Checked<NdArray>> {
    NB_TYPE_CASTER(Checked<NdArray>, make_caster<NdArray>::Name)

    template <class Flags> bool from_python(handle source, Flags flags, cleanup_list *cleanup) noexcept {
        constexpr auto convert = static_cast<Flags>(cast_flags::convert);
        const bool converts = std::is_const_v<typename NdArray::Scalar> && (flags & convert);
        flags = static_cast<Flags>(flags & ~convert);  // nanobind's way is not safe at the end of the interpreter
        if (takes(source, flags, cleanup)) return true;
        if (!converts) return false;
        using Type = std::remove_const_t<typename NdArray::Scalar>;
        const object copy = steal(converted(source.ptr(), name_of_type<Type>().c_str()));
        return copy.is_valid() && takes(copy, flags, cleanup);
    }

  private:
    template <class Flags> bool takes(handle source, Flags flags, cleanup_list *cleanup) noexcept {
        make_caster<NdArray> any;
        if (!any.from_python(source, flags, cleanup)) return false;
        value = Checked<NdArray>(std::move(any.value));
        return reinterpret_cast<std::uintptr_t>(value.data()) % sizeof(typename NdArray::Scalar) == 0;
    }
};

template <class T, nanobind::ssize_t... Shape>
using Array = Checked<nanobind::ndarray<const T, nanobind::shape<Shape...>, nanobind::c_contig, nanobind::device::cpu>>;
using Rows = Array<double, -1, 3>;
using Affine = Array<double, 4, 3>;

/// The lengths of the first three axes.
template <class A> std::array<std::size_t, 3> lattice_of(const A &array) {
    return {array.shape(0), array.shape(1), array.shape(2)};
}

/// The items of a sequence; what nanobind makes of one by itself ends the process where memory does.
template <class Item> std::vector<Item> items_of(const nanobind::sequence &sequence) {
    std::vector<Item> items;
    for (const nanobind::handle item : sequence) {
        Item read;
        if (!nanobind::try_cast(item, read)) throw nanobind::type_error("an item of a sequence has another type");
        items.push_back(std::move(read));
    }
    return items;
}

/// A new NumPy array that owns its memory.
template <class T, std::size_t N>
nanobind::ndarray<nanobind::numpy, T> new_array(const std::array<std::size_t, N> &shape) {
    using Memory = sono::Buffer<T>;
    auto memory = std::make_unique<Memory>(sono::bytes_of(1, shape));
    nanobind::capsule owner(memory.get(), [](void *p) noexcept { delete static_cast<Memory *>(p); });
    return nanobind::ndarray<nanobind::numpy, T>(memory.release()->data(), N, shape.data(), owner);
}

void bind_bmode(nanobind::module_ &m);
void bind_cholesky(nanobind::module_ &m);
void bind_contact(nanobind::module_ &m);
void bind_elastic(nanobind::module_ &m);
void bind_force(nanobind::module_ &m);
void bind_igtl(nanobind::module_ &m);
void bind_multilevel(nanobind::module_ &m);
void bind_sampling(nanobind::module_ &m);
void bind_reslice(nanobind::module_ &m);
void bind_scatterers(nanobind::module_ &m);
void bind_sums(nanobind::module_ &m);

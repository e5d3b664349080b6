// What the files that bind parts of the core share.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <vector>

using Rows = nanobind::ndarray<const double, nanobind::shape<-1, 3>, nanobind::c_contig, nanobind::device::cpu>;

/// A new NumPy array that owns its memory.
template <class T> nanobind::ndarray<nanobind::numpy, T> new_array(const std::vector<std::size_t> &shape) {
    std::size_t size = 1;
    for (std::size_t n : shape) size *= n;
    T *data = new T[size];
    nanobind::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nanobind::ndarray<nanobind::numpy, T>(data, shape.size(), shape.data(), owner);
}

void bind_cholesky(nanobind::module_ &m);
void bind_multilevel(nanobind::module_ &m);
void bind_sampling(nanobind::module_ &m);

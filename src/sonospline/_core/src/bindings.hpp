// What the files that bind parts of the core share.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>

#include "buffers.hpp"
#include "gil.hpp"

using Rows = nanobind::ndarray<const double, nanobind::shape<-1, 3>, nanobind::c_contig, nanobind::device::cpu>;
using Affine = nanobind::ndarray<const double, nanobind::shape<4, 3>, nanobind::c_contig, nanobind::device::cpu>;

/// A new NumPy array that owns its memory.
template <class T, std::size_t N>
nanobind::ndarray<nanobind::numpy, T> new_array(const std::array<std::size_t, N> &shape) {
    struct Owned {
        void *memory;
        std::size_t bytes;
    };
    const std::size_t bytes = sono::bytes_of(sizeof(T), shape);
    auto *owned = new Owned{sono::take_buffer(bytes), bytes};
    nanobind::capsule owner(owned, [](void *p) noexcept {
        auto *freed = static_cast<Owned *>(p);
        sono::return_buffer(freed->memory, freed->bytes);
        delete freed;
    });
    return nanobind::ndarray<nanobind::numpy, T>(owned->memory, N, shape.data(), owner);
}

void bind_bmode(nanobind::module_ &m);
void bind_cholesky(nanobind::module_ &m);
void bind_elastic(nanobind::module_ &m);
void bind_multilevel(nanobind::module_ &m);
void bind_sampling(nanobind::module_ &m);
void bind_reslice(nanobind::module_ &m);
void bind_scatterers(nanobind::module_ &m);

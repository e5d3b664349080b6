"""Sums of radial kernels and of Kelvinlets.

Points (m, 3), centres (n, 3), weights (n, 3) and affine (4, 3) are float64. Every sum is
``affine[0] + p @ affine[1:] + sum_j weights[j] U(|p - centres[j]|)``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from .checks import require, same_length

Array = NDArray[np.float64]

# The largest block of the (points x centres) matrix held at once, in elements.
_BLOCK = 4_000_000

_VALUE: dict[int, Callable[[Array], Array]] = {0: lambda r: r, 1: lambda r: r**3}
# U'(r) / r, taken as 0 at r = 0, where grad r has its kink.
_SLOPE: dict[int, Callable[[Array], Array]] = {
    0: lambda r: np.divide(1.0, r, out=np.zeros_like(r), where=r > 0),
    1: lambda r: 3 * r,
}


def _of(functions: dict[int, Callable[[Array], Array]], kernel: int) -> Callable[[Array], Array]:
    require(kernel in functions, "kernel is neither 0 (r) nor 1 (r^3)")
    return functions[kernel]


def _distances(points: Array, centres: Array) -> Array:
    squared = np.zeros((len(points), len(centres)), points.dtype)
    for axis in range(3):
        difference = points[:, None, axis] - centres[None, :, axis]
        squared += difference * difference
    return np.sqrt(squared, out=squared)


def _blocks(count: int, centres: int) -> Iterator[slice]:
    size = max(1, _BLOCK // max(1, centres))
    return (slice(start, start + size) for start in range(0, count, size))


def _sum_at_points(
    kernel: int, points: Array, centres: Array, weights: Array, affine: Array, dtype: DTypeLike
) -> NDArray[Any]:
    same_length("centres", centres, "weights", weights)
    value = _of(_VALUE, kernel)
    points, centres, weights, affine = (a.astype(dtype, copy=False) for a in (points, centres, weights, affine))
    out = points @ affine[1:] + affine[0]
    for block in _blocks(len(points), len(centres)):
        out[block] += value(_distances(points[block], centres)) @ weights
    return out


def sum_at_points_f32(kernel: int, points: Array, centres: Array, weights: Array, affine: Array) -> NDArray[np.float32]:
    return _sum_at_points(kernel, points, centres, weights, affine, np.float32)


def sum_at_points_f64(kernel: int, points: Array, centres: Array, weights: Array, affine: Array) -> Array:
    return _sum_at_points(kernel, points, centres, weights, affine, np.float64)


def _sum_on_lattice(
    kernel: int,
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    centres: Array,
    weights: Array,
    affine: Array,
    dtype: DTypeLike,
) -> NDArray[Any]:
    nodes = np.indices(shape).reshape(3, -1).T * np.asarray(spacing)
    return _sum_at_points(kernel, nodes, centres, weights, affine, dtype).reshape(*shape, 3)


def sum_on_lattice_f32(
    kernel: int,
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    centres: Array,
    weights: Array,
    affine: Array,
) -> NDArray[np.float32]:
    return _sum_on_lattice(kernel, shape, spacing, centres, weights, affine, np.float32)


def sum_on_lattice_f64(
    kernel: int,
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    centres: Array,
    weights: Array,
    affine: Array,
) -> Array:
    return _sum_on_lattice(kernel, shape, spacing, centres, weights, affine, np.float64)


def gradient_at_points(kernel: int, points: Array, centres: Array, weights: Array, affine: Array) -> Array:
    same_length("centres", centres, "weights", weights)
    slope_of = _of(_SLOPE, kernel)
    out = np.empty((len(points), 3, 3))
    for block in _blocks(len(points), len(centres)):
        slope = slope_of(_distances(points[block], centres))
        for axis in range(3):
            difference = points[block, None, axis] - centres[None, :, axis]
            out[block, :, axis] = (slope * difference) @ weights
    return out + affine[1:].T


def kelvinlet_sum(points: Array, centres: Array, forces: Array, width: float, poissons_ratio: float) -> Array:
    """Return the sum over centres (n, 3) of regularised Kelvinlets K(p - c) f at points (m, 3)."""
    same_length("centres", centres, "forces", forces)
    out = np.empty((len(points), 3))
    a = 1 / (4 * np.pi)
    b = a / (4 * (1 - poissons_ratio))
    offset = np.einsum("ja,ja->j", centres, forces)
    for block in _blocks(len(points), len(centres)):
        p = points[block]
        squared = (p**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2 * p @ centres.T
        inverse = 1 / np.sqrt(np.maximum(squared, 0.0) + width**2)
        cube = inverse**3
        along = b * cube * (p @ forces.T - offset)
        same = (a - b) * inverse + 0.5 * a * width**2 * cube
        out[block] = same @ forces + p * along.sum(axis=1)[:, None] - along @ centres
    return out


def kernel_matrix(kernel: int, points: Array, centres: Array) -> Array:
    return _of(_VALUE, kernel)(_distances(points, centres))

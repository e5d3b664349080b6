"""NumPy twin of the compiled core: same names, same arguments, same results, slower.

Points (m, 3), centres (n, 3), weights (n, 3) and affine (4, 3) are float64. Every sum is
``affine[0] + p @ affine[1:] + sum_j weights[j] U(|p - centres[j]|)``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from .twin_bmode import BmodePlan as BmodePlan
from .twin_checks import require, same_length
from .twin_elastic import ElasticMultigrid as ElasticMultigrid
from .twin_elastic import line_load as line_load
from .twin_multilevel import MultilevelPlan as MultilevelPlan
from .twin_sampling import gradient_lattice as gradient_lattice
from .twin_sampling import invert_lattice as invert_lattice
from .twin_sampling import resample_lattice as resample_lattice
from .twin_sampling import reslice as reslice
from .twin_sampling import sample_lattice as sample_lattice
from .twin_scatterers import EchoScene as EchoScene

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


class CholeskyFactor:
    """A Cholesky factor that grows by rows and can be cut back."""

    def __init__(self) -> None:
        self._factor = np.zeros((0, 0))

    @property
    def size(self) -> int:
        """Rows factored so far."""
        return len(self._factor)

    def append(self, rows: Array, smallest_pivot: float) -> bool:
        """Append rows (m, size + m) of the matrix; False, and no change, at too small a pivot."""
        from scipy.linalg import solve_triangular

        old = self.size
        require(rows.shape[1] == old + len(rows), "rows is not (m, size + m)")
        left = solve_triangular(self._factor, rows[:, :old].T, lower=True).T
        try:
            corner = np.linalg.cholesky(rows[:, old:] - left @ left.T)
        except np.linalg.LinAlgError:
            return False
        if len(corner) and np.diag(corner).min() ** 2 <= smallest_pivot:
            return False
        self._factor = np.block([[self._factor, np.zeros((old, len(rows)))], [left, corner]])
        return True

    def reserve(self, rows: int) -> None:
        """Make room for so many rows at once; here nothing to do."""

    def truncate(self, size: int) -> None:
        """Drop all rows from ``size`` on."""
        self._factor = self._factor[:size, :size]

    def solve(self, x: Array, first: int = 0) -> None:
        """Solve A x = b in place for the first n rows: x (3, n) is zero before row ``first``."""
        from scipy.linalg import solve_triangular

        require(x.shape[1] <= self.size, "x is not (3, size) or shorter")
        require(0 <= first <= x.shape[1], "first is beyond the rows of x")
        factor = self._factor[: x.shape[1], : x.shape[1]]
        x[:, first:] = solve_triangular(factor[first:, first:], x[:, first:].T, lower=True).T
        x[:] = solve_triangular(factor, x.T, lower=True, trans="T").T

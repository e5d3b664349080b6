"""NumPy twin of the core's sampling: a lattice field at any points, and its inverse."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..cubic_axis import filter_matrix
from .checks import numbered, require, require_order, require_spacing

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def sample_lattice(values: Single, spacing: tuple[float, float, float], points: Array, order: int = 1) -> Array:
    """Return a field at points (m, 3), beyond the lattice its value at the nearest point of it.

    ``values`` (nx, ny, nz, 3) are those at the nodes, linear between (``order=1``), or the
    coefficients of cubic B-splines, with one more on every side (``order=3``).
    """
    cell, t = _place(values, spacing, points, order)
    return _sum(values, cell, [_WEIGHTS[order](t[:, axis]) for axis in range(3)])


def gradient_lattice(coefficients: Single, spacing: tuple[float, float, float], points: Array) -> Array:
    """Return d u_a / d x_b (m, 3, 3) of a cubic field at points (m, 3); zero across the ends beyond the lattice."""
    cell, t = _place(coefficients, spacing, points, 3)
    index = points / np.array(spacing)
    inside = (index >= 0) & (index <= np.array(coefficients.shape[:3]) - 3)
    out = np.empty((len(points), 3, 3))
    for b in range(3):
        weights = [_WEIGHTS[3](t[:, axis]) for axis in range(3)]
        weights[b] = _cubic_slopes(t[:, b]) * (inside[:, b, None] / spacing[b]).astype(np.float32)
        out[:, :, b] = _sum(coefficients, cell, weights)
    return out


def _place(
    values: Single, spacing: tuple[float, float, float], points: Array, order: int
) -> tuple[NDArray[np.int64], Single]:
    """First node of the sum at each point, and the place in its cell."""
    require_order(values, order)
    require_spacing(spacing)
    last = np.array(values.shape[:3]) - (1 if order == 1 else 3)
    index = np.clip(points / np.array(spacing), 0, last)  # what is no number stays none
    cell = np.minimum(np.nan_to_num(index).astype(np.int64), last - 1)
    return cell, (index - cell).astype(np.float32)


def _sum(values: Single, cell: NDArray[np.int64], weights: list[Single]) -> Array:
    out = np.zeros((len(cell), 3), np.float32)
    for corner in np.ndindex(*(w.shape[1] for w in weights)):
        weight = np.prod([w[:, j] for w, j in zip(weights, corner, strict=True)], axis=0)
        out += weight[:, None] * values[tuple((cell + corner).T)]
    return out.astype(np.float64)


def _cubic(t: Single) -> Single:
    s = 1 - t
    weights = np.stack([s**3, 3 * t**3 - 6 * t**2 + 4, 3 * s**3 - 6 * s**2 + 4, t**3], axis=1) / 6
    return weights.astype(np.float32)


def _cubic_slopes(t: Single) -> Single:
    s = 1 - t
    slopes = np.stack([-(s**2), (3 * t - 4) * t, -(3 * s - 4) * s, t**2], axis=1) / 2
    return slopes.astype(np.float32)


_WEIGHTS: dict[int, Callable[[Single], Single]] = {1: lambda t: np.stack([1 - t, t], axis=1), 3: _cubic}


def invert_lattice(
    values: Single, spacing: tuple[float, float, float], points: Array, tolerance: float, most: int, order: int = 1
) -> tuple[Array, NDArray[np.int32]]:
    """Solve x + u(x) = p for points (m, 3); return x and the iterations taken, 0 where too few were allowed."""
    require(0 <= most <= 1_000_000, "most is not between 0 and 1000000")
    require_order(values, order)
    require_spacing(spacing)
    x = points.copy()
    iterations = np.zeros(len(points), np.int32)
    remaining = np.arange(len(points))
    for step in range(1, most + 1):
        missing = points[remaining] - sample_lattice(values, spacing, x[remaining], order) - x[remaining]
        x[remaining] += missing
        done = (missing**2).sum(axis=1) <= tolerance**2
        iterations[remaining[done]] = step
        remaining = remaining[~done]
        if not len(remaining):
            break
    return x, iterations


def reslice(
    values: NDArray[np.float32],
    spacing: tuple[float, float, float],
    pixel: Array,
    voxels: NDArray[np.float32],
    seen: NDArray[np.uint8] | None,
    index: Array,
    shape: tuple[int, int],
    tolerance: float,
    most: int,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return grey and seen (rows, columns) of a plane through a deformed image, linear between voxels."""
    from scipy.ndimage import map_coordinates

    require(numbered(values.shape[:3], 2), "values has fewer than 2 nodes along an axis, or too many")
    require_spacing(spacing)
    require(min(voxels.shape) >= 1, "voxels is empty, or has too long an axis")
    require(seen is None or seen.shape == voxels.shape, "seen is not of the shape of voxels")
    require(0 <= most <= 10_000, "most is not between 0 and 10000")
    rows, columns = np.indices(shape)
    points = np.column_stack([columns.ravel(), rows.ravel(), np.ones(rows.size)]).astype(np.float64) @ pixel.T
    x, iterations = invert_lattice(values, spacing, points, tolerance, most)
    at = index[:, :3] @ x.T + index[:, 3:]
    last = np.array(voxels.shape)[:, None] - 1
    shown = ((at >= -0.5) & (at <= last + 0.5)).all(axis=0) & (iterations > 0)
    at = np.clip(at, 0, last)
    if seen is not None:
        shown &= seen[tuple(np.floor(at + 0.5).astype(np.int64))] > 0
    grey = np.where(shown, map_coordinates(voxels, at, order=1, mode="nearest"), 0)
    return grey.astype(np.float32).reshape(shape), shown.astype(np.uint8).reshape(shape)


def resample_lattice(values: Single, x: Single, y: Single, z_transposed: Single) -> Single:
    """Return values (3, nx, ny, nz) at the nodes of another lattice, as (mx, my, mz, 3), by cubic splines.

    Weights along x and y, at least 4 nodes each, are those of B-splines; those along z take
    the values themselves, transposed.
    """
    nx, ny, nz = values.shape[1:]
    require(nx >= 4 and ny >= 4 and nz >= 1, "values has fewer than 4 nodes along x or y, or none along z")
    require(
        x.shape[1] == nx + 2 and y.shape[1] == ny + 2 and len(z_transposed) == nz,
        "x, y or z_transposed has not the columns that values takes",
    )
    along_x, along_y = (w @ filter_matrix(w.shape[1] - 2).astype(np.float32) for w in (x, y))
    rows = np.matmul(along_y, values @ z_transposed)
    return np.ascontiguousarray(np.einsum("mi,aiyz->myza", along_x, rows, optimize=True))

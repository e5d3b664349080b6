"""NumPy twin of the core's sampling: a lattice field at any points, and its inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def sample_lattice(values: NDArray[np.float32], spacing: tuple[float, float, float], points: Array) -> Array:
    """Return a field (nx, ny, nz, 3) at points (m, 3), linear between nodes."""
    last = np.array(values.shape[:3]) - 1
    index = np.clip(np.nan_to_num(points / spacing), 0, last)
    cell = np.minimum(index.astype(np.int64), last - 1)
    t = (index - cell).astype(np.float32)
    out = np.zeros((len(points), 3), np.float32)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, t, 1 - t), axis=1)
        out += weight[:, None] * values[tuple((cell + corner).T)]
    return out.astype(np.float64)


def invert_lattice(
    values: NDArray[np.float32], spacing: tuple[float, float, float], points: Array, tolerance: float, most: int
) -> tuple[Array, NDArray[np.int32]]:
    """Solve x + u(x) = p for points (m, 3); return x and the iterations taken, 0 where too few were allowed."""
    x = points.copy()
    iterations = np.zeros(len(points), np.int32)
    remaining = np.arange(len(points))
    for step in range(1, most + 1):
        missing = points[remaining] - sample_lattice(values, spacing, x[remaining]) - x[remaining]
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
    seen: NDArray[np.uint8],
    index: Array,
    shape: tuple[int, int],
    tolerance: float,
    most: int,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return grey and seen (rows, columns) of a plane through a deformed image, linear between voxels."""
    from scipy.ndimage import map_coordinates

    rows, columns = np.indices(shape)
    points = np.column_stack([columns.ravel(), rows.ravel(), np.ones(rows.size)]).astype(np.float64) @ pixel.T
    x, iterations = invert_lattice(values, spacing, points, tolerance, most)
    at = index[:, :3] @ x.T + index[:, 3:]
    last = np.array(voxels.shape)[:, None] - 1
    shown = ((at >= -0.5) & (at <= last + 0.5)).all(axis=0) & (iterations > 0)
    at = np.clip(at, 0, last)
    shown &= seen[tuple(np.floor(at + 0.5).astype(np.int64))] > 0
    grey = np.where(shown, map_coordinates(voxels, at, order=1, mode="nearest"), 0)
    return grey.astype(np.float32).reshape(shape), shown.astype(np.uint8).reshape(shape)

"""Whether a field turns tissue inside out near the needle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from .grid_field import GridField

_REACH_CELLS = 2


def folds(field: GridField, needle: Needle) -> bool:
    """Return whether any cell around the needle has a volume at or below zero.

    The determinant of I + du/dx is taken from forward differences at a corner of each cell in the needle's box, two
    cells wider: where tissue folds, it folds there.
    """
    grid = field.grid
    index = grid.local(np.stack([needle.entry, needle.tip])) / grid.spacing
    last = np.array(grid.shape) - 1
    low = np.clip(np.floor(index.min(axis=0)).astype(int) - _REACH_CELLS, 0, last - 1)
    high = np.clip(np.ceil(index.max(axis=0)).astype(int) + _REACH_CELLS, low + 1, last)
    u = field.along_axes[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))]
    if _gentle(u, grid.spacing):
        return False
    corner = u[:-1, :-1, :-1]
    columns = [
        (u[1:, :-1, :-1] - corner) / grid.spacing[0],
        (u[:-1, 1:, :-1] - corner) / grid.spacing[1],
        (u[:-1, :-1, 1:] - corner) / grid.spacing[2],
    ]
    for axis, column in enumerate(columns):
        column[..., axis] += 1
    a, b, c = (np.moveaxis(column, -1, 0) for column in columns)
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return bool(volume.min() <= 0)


def _gentle(u: NDArray[np.float32], spacing: tuple[float, float, float]) -> bool:
    """Whether no gradient can have a norm of 1, by the largest difference along each axis: then nothing folds."""
    squared = 0.0
    for axis, h in enumerate(spacing):
        step = np.diff(u, axis=axis)
        squared += 3 * (max(float(step.max()), -float(step.min())) / h) ** 2
    return squared < 1

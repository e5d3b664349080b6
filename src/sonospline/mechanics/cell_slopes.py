"""In which directions a value changes within the cells of a grid."""

from __future__ import annotations

from itertools import combinations_with_replacement, pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from .cell_samples import CellSamples

Array = NDArray[np.float64]

_SMOOTHINGS = 1
"""Of samples, by 1 2 1 along each axis, before slopes are read off: voxels are steps."""
_RING = _SMOOTHINGS + 1
"""Samples around a cell that are looked at."""
_PLANES = 4
"""Of cells, whose values stay in the cache of a processor."""


def directions(cells: CellSamples, which: NDArray[np.int64], values: Array, spacing: Array) -> Array:
    """Return the direction (n, 3) in which a value changes most in some cells, as :func:`squares_of_slopes`."""
    return np.asarray(np.linalg.eigh(squares_of_slopes(cells, which, values, spacing))[1][:, :, -1])


def squares_of_slopes(cells: CellSamples, which: NDArray[np.int64], values: Array, spacing: Array) -> Array:
    """Return sums (n, 3, 3) over some cells of the products of a value's slopes along the axes.

    Of smoothed samples, between all of them: a thin layer's two sides would cancel in a mean.

    Parameters
    ----------
    cells : CellSamples
        Of a grid.
    which : (n, 3) ndarray
        Indices of cells, in order.
    values : (materials,) ndarray
        Of each material, such as the logarithm of its stiffness.
    spacing : (3,) ndarray
        Sides of a cell.
    """
    padded, single = np.pad(cells.samples, _RING, mode="edge"), values.astype(np.float32)
    planes = np.arange(0, cells.first.shape[0] + _PLANES, _PLANES)
    starts = np.searchsorted(which[:, 0], planes)
    found = np.empty((len(which), 3, 3))
    for some in (slice(*ends) for ends in pairwise(starts) if ends[0] < ends[1]):
        low, high = which[some].min(axis=0), which[some].max(axis=0) + 1
        ends = zip(low * cells.counts, high * cells.counts + 2 * _RING, strict=True)
        around = single[padded[tuple(slice(*end) for end in ends)]]
        found[some] = _squares(around, which[some] - low, cells.counts, spacing)
    return found


def _squares(around: NDArray[np.float32], which: NDArray[np.int64], counts: NDArray[np.int64], spacing: Array) -> Array:
    """Sums (n, 3, 3) over cells, of samples that reach a ring beyond the cells."""
    for axis in 2 * _SMOOTHINGS * (0, 1, 2):
        around = _sums(around, axis)
    slopes = []
    for axis in range(3):
        every = sliding_window_view(_slopes(around, axis), tuple(counts + 1))
        of_cells = every[:: counts[0], :: counts[1], :: counts[2]][tuple(which.T)]
        slopes.append(of_cells.reshape(len(which), -1) * (counts[axis] / spacing[axis]))
    squares = np.empty((len(which), 3, 3))
    for a, b in combinations_with_replacement(range(3), 2):
        squares[:, a, b] = squares[:, b, a] = (slopes[a] * slopes[b]).sum(axis=1)
    return squares


def _sums(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Sums of neighbours along an axis."""
    lines = np.moveaxis(values, axis, 0)
    return np.moveaxis(lines[1:] + lines[:-1], 0, axis)


def _slopes(values: NDArray[np.float32], along: int) -> NDArray[np.float32]:
    """Differences along one axis, between eight neighbours."""
    lines = np.moveaxis(values, along, 0)
    values = np.moveaxis(lines[1:] - lines[:-1], 0, along)
    for axis in {0, 1, 2} - {along}:
        values = _sums(values, axis)
    return values

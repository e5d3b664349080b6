"""Which tissues the cells of a grid hold, from a label image sampled at regular places in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid
from ..geometry.label_map import HALF
from ..geometry.volume import Volume

Array = NDArray[np.float64]
Places = NDArray[np.integer]
"""Numbers of materials in a table."""

FEWEST_SAMPLES, MOST_SAMPLES = 3, 5
"""Along each axis of a cell. Odd, since an even number has ties, of which bone would take all; three leave a layer half
as thick as a cell a tenth further off, and bone of cells hardly larger than voxels, sampled once, up to a third."""
MOST_IN_ALL = 4_000_000
"""Samples of a grid beyond which the fewest are taken: set-up stays below a third of a second."""
NO_BACKGROUND = "labels end inside the tissue's box, and label 0, the background beyond, has no material; add one"


class CellSamples:
    """The materials of a grid's cells.

    Parameters
    ----------
    labels : Volume
        The label image.
    places : ndarray of int
        The material of each of its voxels, as a place in a table.
    grid : Grid
        Its cells are sampled: three times along each axis, or five where they are larger than three voxels.
    background : int or None
        The material beyond the image; None where there is none.

    Raises
    ------
    ValueError
        The image and the grid do not overlap, or the grid is larger and there is no background.
    """

    def __init__(self, labels: Volume, places: Places, grid: Grid, background: int | None) -> None:
        self.counts = _counts(np.array(grid.spacing) / labels.spacing, np.array(grid.shape) - 1)
        """Samples along each axis of a cell."""
        self.samples = _sampled(labels, places, grid, background, self.counts)
        """(cx nx, cy ny, cz nz) all of them, in space."""
        cells = [n - 1 for n in grid.shape]
        by_cell = self.samples.reshape(np.stack([cells, self.counts], axis=1).ravel()).transpose(1, 3, 5, 0, 2, 4)
        each = by_cell.reshape(-1, *cells)
        self.first = each[0]
        """(cx, cy, cz) the first of each cell: the only material of most."""
        self.mixed = (each != self.first).any(axis=0)
        """(cx, cy, cz) whether a cell holds several materials."""
        self.held, self.kind = _kinds(each[:, self.mixed])
        """(samples, kinds) what those hold, once where it is the same in the same places; and (mixed cells,) which of
        the kinds each is: a few thousand of tens of thousands."""

    def mean(self, values: Array) -> Array:
        """Return the mean over each cell of a value for each material."""
        means = values[self.first]
        means[self.mixed] = values[self.held].mean(axis=0)[self.kind]
        return means


def _kinds(held: Places) -> tuple[Places, NDArray[np.intp]]:
    """The columns that differ, and which of them each is."""
    rows = np.ascontiguousarray(held.T)
    whole = rows.view(np.dtype((np.void, rows.itemsize * len(held)))).ravel()
    _, first, kind = np.unique(whole, return_index=True, return_inverse=True)
    return np.ascontiguousarray(held[:, first]), kind


def _counts(voxels_a_cell: Array, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    counts = np.where(voxels_a_cell > FEWEST_SAMPLES, MOST_SAMPLES, FEWEST_SAMPLES)
    return counts if np.prod(cells * counts) <= MOST_IN_ALL else np.full(3, FEWEST_SAMPLES)


def _sampled(labels: Volume, places: Places, grid: Grid, background: int | None, counts: NDArray[np.int64]) -> Places:
    cells = np.array(grid.shape) - 1
    axes = [
        (np.arange(number * count) + 0.5) * (h / count)
        for number, count, h in zip(cells, counts, grid.spacing, strict=True)
    ]
    turn = labels.lattice.direction.T @ grid.direction
    start = labels.index(grid.origin[None])[0]
    last = np.array(labels.voxels.shape) - 1
    if np.allclose(turn, np.eye(3), atol=1e-9):
        index = [start[a] + axes[a] / labels.spacing[a] for a in range(3)]
        i, j, k = (np.clip(np.rint(i), 0, n).astype(int) for i, n in zip(index, last, strict=True))
        found = places.take(k, axis=2).take(j, axis=1).take(i, axis=0)  # whole rows and planes are copied last
        x, y, z = (_within(i, n) for i, n in zip(index, last, strict=True))
        inside = np.asarray(x[:, None, None] & y[:, None] & z)
    else:
        local = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        index_at = start + local @ turn.T / labels.spacing
        inside = np.asarray(_within(index_at, last).all(axis=-1))
        near = np.clip(np.rint(index_at), 0, last).astype(int)
        found = places[tuple(np.moveaxis(near, -1, 0))]
    if not inside.any():
        raise ValueError("labels do not overlap the tissue's box; give labels of the same patient and place")
    if not inside.all():
        if background is None:
            raise ValueError(NO_BACKGROUND)
        found[~inside] = background
    return found


def _within(index: Array, last: Any) -> NDArray[np.bool_]:
    """Whether continuous indices lie in a voxel, the first 0, the last ``last``."""
    return (index >= -HALF) & (index <= last + HALF)

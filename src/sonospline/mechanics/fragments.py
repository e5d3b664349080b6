"""Fragments of bone: which cells of a grid move together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.bool_]
Numbers = NDArray[np.int32]


def corners_of(cells: Cells) -> Cells:
    """Return which nodes (nx, ny, nz) are a corner of one of the cells (cx, cy, cz)."""
    nodes = np.zeros([n + 1 for n in cells.shape], bool)
    cx, cy, cz = cells.shape
    for i, j, k in np.ndindex(2, 2, 2):
        nodes[i : cx + i, j : cy + j, k : cz + k] |= cells
    return nodes


def fragments_of(floating: Cells, fixed: Cells) -> Numbers:
    """Return the number of the fragment each cell belongs to, from 1 on; 0 of the others.

    Cells that share a corner belong together.

    Parameters
    ----------
    floating : (cx, cy, cz) ndarray of bool
        Cells of bone that may move.
    fixed : (cx, cy, cz) ndarray of bool
        Cells of bone that do not.

    Raises
    ------
    ValueError
        A fragment of a single cell, or one that touches bone that does not move.
    """
    numbers = np.zeros(floating.shape, np.int32)
    if not floating.any():
        return numbers
    from scipy.ndimage import label

    label(floating, np.ones((3, 3, 3)), output=numbers)
    sizes = np.bincount(numbers.ravel())[1:]
    if sizes.min() == 1:
        raise ValueError(
            "labels: a floating fragment fills a single cell of the solver's grid; give more nodes, or make it soft"
        )
    if (corners_of(floating) & corners_of(fixed)).any():
        raise ValueError(
            "labels: a floating fragment touches bone that does not move, and so cannot either; leave a cell of soft "
            "tissue between them, give more nodes, or make both floating"
        )
    return numbers

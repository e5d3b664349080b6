"""Bone that fills cells in part: springs that hold their corners.

A cell is all rigid or all soft, where bone ends within it: the wall that stops tissue is up to half a cell off.
Springs to the ground, shared out by how much of the bone each corner sees, put the wall where bone is (the penalty
method of fictitious domains: Angot, Bruneau and Fabrie, *Numer. Math.* 81 (1999) 497), and cost a product no more than
a diagonal does. A wall across n holds tissue by its acoustic tensor, mu I + (lambda + mu) n n^T, of which the diagonal
is taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .cell_samples import CellSamples
from .cell_slopes import squares_of_slopes

Array = NDArray[np.float64]

STIFFNESS = 10.0
"""Springs of a cell that is bone over its side and its acoustic tensor. In cells that a flat wall cuts in two they
should be 8 and where it leaves a tenth of them 22; beside ribs and vertebrae fields are nearest those of fine grids."""

_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T


class HeldBone(NamedTuple):
    """Which part of some cells is bone that does not move."""

    cells: NDArray[np.int64]
    """(n, 3) index of each."""
    shares: Array
    """(n, 8) integrals over bone of the hat functions of its corners, z fastest, over the volume of a cell."""
    facing: Array
    """(n, 3) mean squares of the components of the normals of its walls: 1, 0, 0 across the first axis."""

    @classmethod
    def none(cls) -> HeldBone:
        """Return no cell that holds bone."""
        return cls(np.zeros((0, 3), np.int64), np.zeros((0, 8)), np.zeros((0, 3)))

    @classmethod
    def of(cls, cells: CellSamples, bone: NDArray[np.bool_], soft: NDArray[np.bool_], spacing: Array) -> HeldBone:
        """Return the bone of the cells that are not all rigid.

        Parameters
        ----------
        cells : CellSamples
            Of a grid.
        bone : (materials,) ndarray of bool
            Which of the materials do not move.
        soft : (cx, cy, cz) ndarray of bool
            The cells that are not rigid.
        spacing : (3,) ndarray
            Sides of a cell.
        """
        places = [(np.arange(count) + 0.5) / count for count in cells.counts]
        place = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 1, 3)
        hats = np.where(_CORNERS, place, 1 - place).prod(axis=-1)  # (samples, corners)
        in_part = soft & cells.mixed
        kinds = cells.kind[in_part[cells.mixed]]
        shares = (bone[cells.held].T.astype(float) @ hats / len(hats))[kinds]
        some = shares.any(axis=1)
        which, shares = np.argwhere(in_part)[some], shares[some]
        if not len(which):
            return cls.none()
        squares = np.einsum("naa->na", squares_of_slopes(cells, which, bone.astype(float), spacing))
        return cls(which, shares, squares / squares.sum(axis=1, keepdims=True))

    def at_corners(self, lame: Array, shear: Array, spacing: tuple[float, float, float]) -> Array:
        """Return the springs (n, 8, 3) at the corners of each cell along the axes, in kPa mm.

        Parameters
        ----------
        lame, shear : (cx, cy, cz) ndarray
            Moduli of all cells: of what else these hold.
        spacing : (3,) ndarray
            Sides of a cell.
        """
        first, second = (values[tuple(self.cells.T)][:, None] for values in (lame, shear))
        wall = second + (first + second) * self.facing
        return np.asarray(STIFFNESS * np.prod(spacing) ** (1 / 3) * self.shares[:, :, None] * wall[:, None])

    def at_nodes(self, lame: Array, shear: Array, spacing: tuple[float, float, float]) -> Array:
        """Return the springs (3, nx, ny, nz) at the nodes along the axes, as :meth:`at_corners` of each cell."""
        nodes = tuple(n + 1 for n in shear.shape)
        numbers = np.ravel_multi_index(tuple((self.cells[:, None] + _CORNERS).reshape(-1, 3).T), nodes)
        springs = self.at_corners(lame, shear, spacing).reshape(-1, 3).T
        sums = [np.bincount(numbers, along, int(np.prod(nodes))) for along in springs]
        return np.reshape(sums, (3, *nodes))

    def __repr__(self) -> str:
        return f"HeldBone({len(self.cells)} cells)"

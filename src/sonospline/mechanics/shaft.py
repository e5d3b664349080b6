"""The inserted shaft of a needle, and which tissue it is in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._by_bits import ByBits
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from .nodal_displacement import undeformed

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_ITERATIONS = 40
"""Of the inverse map, at most."""


@dataclass(frozen=True, eq=False)
class Shaft(ByBits):
    """Where the tissue that a needle is in was before it moved: along a straight needle, a curve.

    Parameters
    ----------
    along : (n,) ndarray
        Distances from the entry along the needle, rising, both ends among them.
    places : (n, 3) ndarray
        Where the tissue there is while undeformed, in the world.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.mechanics import Shaft
    >>> Shaft.undeformed(ss.Needle((0, 50, 50), (60, 50, 50))).at([0, 30]).tolist()
    [[0.0, 50.0, 50.0], [30.0, 50.0, 50.0]]
    """

    along: Array
    places: Array

    @classmethod
    def undeformed(cls, needle: Needle) -> Shaft:
        """Return the shaft of a needle in tissue that has not moved."""
        return cls(np.array([0.0, needle.depth]), np.stack([needle.entry, needle.tip]))

    @classmethod
    def deformed(cls, needle: Needle, displacement: Single, grid: Grid, apart: float) -> Shaft:
        """Return the shaft of a needle in tissue that nodes (3, nx, ny, nz) of a grid have moved.

        Tissue is looked for at points at most ``apart`` from each other.
        """
        along = np.linspace(0.0, needle.depth, int(np.ceil(needle.depth / apart)) + 1)
        points = grid.local(needle.at(along / needle.depth))
        return cls(along, grid.world(undeformed(displacement, grid, points, points, _ITERATIONS)))

    def moved_on(self, needle: Needle, displacement: Single, grid: Grid) -> float:
        """Return how far the tissue that a needle is in, as a displacement has it, is from where this shaft has it."""
        points, places = grid.local(needle.at(self.along / needle.depth)), grid.local(self.places)
        found = undeformed(displacement, grid, points, places, 1)
        return float(np.sqrt(((found - places) ** 2).sum(axis=1).max()))

    def at(self, along: ArrayLike) -> Array:
        """Return where the tissue (m, 3) at distances from the entry was, linear between the known places."""
        wanted = np.asarray(along, float)
        return np.stack([np.interp(wanted, self.along, places) for places in self.places.T], axis=-1)

    def __repr__(self) -> str:
        return f"Shaft({len(self.along)} points, {self.along[-1]:.4g} deep)"

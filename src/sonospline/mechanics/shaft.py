"""The inserted shaft of a needle, and which tissue it is in."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
_LEAST = 0.3
"""Of the way to the tissue found, what a shaft goes at least where two ways were opposed: with less it stays beside."""


@dataclass(frozen=True, eq=False)
class Shaft(ByBits):
    """Where the tissue that a needle is in was before it moved: along a straight needle, a curve.

    Parameters
    ----------
    along : (n,) ndarray
        Distances from the entry along the needle, rising, both ends among them.
    places : (n, 3) ndarray
        Where the tissue there is while undeformed, in the world.
    share : float, default: 1.0
        Of the way from the last shaft to the tissue found, that this one has gone.
    way : (n, 3) ndarray, optional
        All of that way, where it was asked for.
    found : (n, 3) ndarray, optional
        Where the tissue was found, where that is not where it is taken to be.
    drift : (n, 3) ndarray, optional
        How far the step after which it was found moved it on, for each mm that the needle went in.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.mechanics import Shaft
    >>> Shaft.undeformed(ss.Needle((0, 50, 50), (60, 50, 50))).at([0, 30]).tolist()
    [[0.0, 50.0, 50.0], [30.0, 50.0, 50.0]]
    """

    along: Array
    places: Array
    share: float = 1.0
    way: Array | None = None
    found: Array | None = None
    drift: Array | None = None

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

    def damped(self, needle: Needle, last: Shaft, was: Needle, grid: Grid, furthest: float) -> Shaft:
        """Return a shaft that is on the way from the last one, of a needle as it was, to this one that was found.

        The last one is taken along with the tip. The share of the way is the one with which the last two ways would
        have met (Aitken's, for vectors): where soft tissue behind stiff tissue takes a load further than it finds it,
        the whole way each time leads to and fro. No place goes further than ``furthest``, in mm.
        """
        behind, was_behind = self.along - needle.depth, last.along - was.depth
        moved = _between(behind, was_behind, was.at(last.along / was.depth) - last.places)
        start = grid.local(needle.at(self.along / needle.depth) - moved)
        start = _within(grid, start)
        way, share = self.places - start, max(last.share, _LEAST)
        if last.way is not None:
            before = _between(behind, was_behind, last.way)
            change = way - before
            if change.any():
                share = float(np.clip(-last.share * (before * change).sum() / (change**2).sum(), _LEAST, 1.0))
        longest = _longest(way)
        share = share if share * longest <= furthest else furthest / longest
        return Shaft(self.along, self.places if share == 1.0 else start + share * way, share, way, self.places)

    def ahead(self, needle: Needle, last: Shaft, was: Needle, grid: Grid) -> Shaft:
        """Return a shaft that has gone on as the last one did, of a needle as it was: this one was found a step ago.

        Without it a load lags by what its tissue moves in a step. No place goes further than the needle.
        """
        advance = _advance(needle, was)
        if last.drift is None or advance <= 0:
            return self
        drift = _between(self.along - needle.depth, last.along - was.depth, last.drift)
        drift /= max(1.0, _longest(drift))
        places = _within(grid, grid.local(self.places + advance * drift))
        return Shaft(self.along, places, found=self.places)

    def drifting(self, needle: Needle, first: Shaft, was: Needle, sought: Array) -> Shaft:
        """Return this shaft, with how far a step moved the tissue on in which its needle, before as it was, was first.

        Where the tissue (n, 3) is after the step is said by :meth:`sought`.
        """
        advance = _advance(needle, was)
        before = first.places if first.found is None else first.found
        return replace(self, drift=(sought - before) / advance if advance > 0 else None)

    def sought(self, needle: Needle, displacement: Single, grid: Grid) -> Array:
        """Return where the tissue (n, 3) is that a needle is in, as a displacement has it.

        By one iteration from where this shaft has it.
        """
        points, places = grid.local(needle.at(self.along / needle.depth)), grid.local(self.places)
        return grid.world(undeformed(displacement, grid, points, places, 1))

    def beside(self, sought: Array) -> float:
        """Return how far places (n, 3) of tissue are, at most, from where this shaft has it."""
        return _longest(sought - self.places)

    def at(self, along: ArrayLike) -> Array:
        """Return where the tissue (m, 3) at distances from the entry was, linear between the known places."""
        return _between(along, self.along, self.places)

    def __repr__(self) -> str:
        return f"Shaft({len(self.along)} points, {self.along[-1]:.4g} deep)"


def _advance(needle: Needle, was: Needle) -> float:
    """How far a needle has gone in along itself."""
    return float((needle.tip - was.tip) @ needle.direction)


def _longest(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).max()))


def _within(grid: Grid, points: Array) -> Array:
    """Points (n, 3) along a grid's axes, in the world; those beyond a face are on it."""
    return grid.world(np.clip(points, 0.0, grid.extent))


def _between(wanted: ArrayLike, along: Array, values: Array) -> Array:
    """The values (n, 3) at some distances, linear between those along which they are known."""
    return np.stack([np.interp(np.asarray(wanted, float), along, value) for value in values.T], axis=-1)

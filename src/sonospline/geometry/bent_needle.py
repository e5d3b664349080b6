"""The shape of a needle that bends: a curve from its entry into the tissue to its tip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_value import ByValue
from .._shown import place

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BentNeedle(ByValue):
    """Points along a needle's axis, from its entry to its tip, in world coordinates (mm): straight between them.

    Models of tissue take rigid needles; images show a bent one as it lies.

    Parameters
    ----------
    points : (m, 3) array_like
        At least two, each different from the one before; close enough together for the bend.

    Raises
    ------
    ValueError
        Fewer than two points, points that are not finite, or the same point twice in a row.

    Examples
    --------
    >>> from sonospline.geometry import BentNeedle
    >>> bent = BentNeedle([(0, 0, 0), (3, 0, 0), (3, 0, 4)])
    >>> bent.depth, bent.at(0.5).tolist()
    (7.0, [3.0, 0.0, 0.5])
    """

    points: Array

    def __init__(self, points: ArrayLike) -> None:
        found, shape = _validate.rows("points", points)
        if len(shape) != 1 or len(found) < 2:
            raise ValueError(f"points has shape {np.shape(points)}; give an (m, 3) array of at least two points")
        object.__setattr__(self, "points", found)
        same = np.flatnonzero(np.diff(self._passed) <= 1e-12 * max(1.0, float(np.abs(found).max())))
        if len(same):
            raise ValueError(f"points[{same[0]}] and the next are both {place(found[same[0]])}; leave one out")

    def __repr__(self) -> str:
        return f"BentNeedle({len(self.points)} points, entry={place(self.points[0])}, tip={place(self.points[-1])})"

    @cached_property
    def depth(self) -> float:
        """Inserted length along the curve, mm."""
        return float(self._passed[-1])

    def at(self, t: ArrayLike) -> Array:
        """Return the shaft's points at shares of its length, 0 <= t <= 1."""
        return self._between(self.points, t)

    def directions(self, t: ArrayLike) -> Array:
        """Return unit vectors along the shaft there, which turn evenly from one point to the next."""
        turned = self._between(np.gradient(self.points, self._passed, axis=0), t)
        along: Array = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
        return along

    @cached_property
    def _passed(self) -> Array:
        """(m,) length up to each point."""
        return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))

    def _between(self, values: Array, t: ArrayLike) -> Array:
        passed = np.asarray(t, float) * self.depth
        return np.stack([np.interp(passed, self._passed, axis) for axis in values.T], axis=-1)

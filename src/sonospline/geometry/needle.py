"""The needle: a straight line from its entry into the tissue to its tip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_value import ByValue
from .._shown import place

Array = NDArray[np.float64]


class Projection(NamedTuple):
    """Points seen from the needle's axis, equations (11) to (13)."""

    along: Array
    """(m,) tau: signed distance along the axis from the entry, eq. (11); a number for one point."""
    foot: Array
    """(m, 3) p: closest point of the axis, eq. (12)."""
    distance: Array
    """(m,) d: distance from the axis, eq. (13)."""

    def __repr__(self) -> str:
        return f"Projection({np.size(self.along)} points)"


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Needle(ByValue):
    """A rigid needle of zero width, entry n_s and tip n_t in world coordinates (mm).

    Parameters
    ----------
    entry : (3,) array_like
        Where the needle enters the tissue, n_s.
    tip : (3,) array_like
        Where its tip is, n_t; different from the entry.

    Raises
    ------
    ValueError
        A point that is not three finite numbers, or a tip equal to the entry, which
        leaves the direction undefined.

    Examples
    --------
    >>> import sonospline as ss
    >>> needle = ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5))
    >>> needle.depth, needle.direction.tolist()
    (0.6, [1.0, 0.0, 0.0])
    """

    entry: Array
    tip: Array

    def __init__(self, entry: ArrayLike, tip: ArrayLike) -> None:
        object.__setattr__(self, "entry", _validate.vector("entry", entry))
        object.__setattr__(self, "tip", _validate.vector("tip", tip))
        if self.depth <= 1e-12 * max(1.0, float(np.abs(self.entry).max())):
            raise ValueError(f"tip = {self.tip.tolist()} equals the entry; move the tip off the entry point")

    def __repr__(self) -> str:
        return f"Needle(entry={place(self.entry)}, tip={place(self.tip)})"

    @cached_property
    def depth(self) -> float:
        """Inserted length ``|n_t - n_s|`` in mm."""
        return float(np.linalg.norm(self.tip - self.entry))

    @cached_property
    def direction(self) -> Array:
        """(3,) unit vector of the insertion, eq. (10)."""
        return (self.tip - self.entry) / self.depth

    @property
    def points(self) -> Array:
        """(2, 3) entry and tip."""
        return np.stack([self.entry, self.tip])

    def at(self, t: ArrayLike) -> Array:
        """Return the shaft point n(t) = n_s + t (n_t - n_s), 0 <= t <= 1, eq. (9)."""
        return self.entry + np.asarray(t, float)[..., None] * (self.tip - self.entry)

    def project(self, points: ArrayLike) -> Projection:
        """Return distances of points (m, 3), or of one (3,), along and from the axis, eqs (11) to (13)."""
        points = np.asarray(points, float)
        along = (points - self.entry) @ self.direction
        foot = self.entry + along[..., None] * self.direction
        return Projection(along, foot, np.linalg.norm(points - foot, axis=-1))


def equal_steps(whole: Needle, steps: int) -> list[Needle]:
    """Return the needle after each of so many equal steps from its entry to its tip."""
    return [Needle(whole.entry, whole.at(k / steps)) for k in range(1, steps + 1)]

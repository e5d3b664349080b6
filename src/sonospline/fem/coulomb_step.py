"""One step of Coulomb friction along a needle and of the tip that cuts: which points stick, slide or lose it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._by_bits import ByBits
from .bounded_forces import bounded_forces

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_NEARER = 0.1
"""Of the tolerance, to which the depth of the cut is found."""
_FAR = 1e3
"""Tolerances beyond the tip's travel, where the cut ends at the latest."""
_GUESS = 1.25
"""Of the tip's lead on the tissue that it cuts, within which the cut is expected to end."""


@dataclass(frozen=True, eq=False, repr=False)
class Contact(ByBits):
    """What a needle has cut, and how it grips the points of its track."""

    cut: float
    """How deep the needle has cut, in undeformed tissue."""
    anchors: Array
    """(m,) distance behind the tip of the place on the needle that each point is at."""
    touching: Mask
    """(m,) points beside the needle, the tip being past them."""
    sliding: NDArray[np.int8]
    """(m,) 1 where the needle slides forward past a point, -1 where backward, 0 where they stick."""
    forces: Array
    """(m,) of the needle on each point, along it."""
    tip_force: float
    """Of the tip on the tissue that is not cut yet."""

    def __post_init__(self) -> None:
        for array in (self.anchors, self.touching, self.sliding, self.forces):
            array.setflags(write=False)

    @classmethod
    def none(cls, points: int) -> Contact:
        """Return that of a needle which has touched nothing."""
        nothing = np.zeros(points)
        return cls(0.0, nothing, nothing.astype(bool), nothing.astype(np.int8), nothing, 0.0)

    def __repr__(self) -> str:
        return f"Contact(cut {self.cut:.4g}, {int(self.touching.sum())} of {len(self.forces)} points touching)"


@dataclass(frozen=True)
class Friction:
    """What the points of a track and the tissue at the tip resist with."""

    depths: Array
    """(m,) of the points while undeformed, rising."""
    static: Array
    kinetic: Array
    """(m,) largest force of a point that sticks, and of one that slides."""
    viscous: Array
    """(m,) what a point that slides resists with besides, by the speed of the slip."""
    cutting: Callable[[float], float]
    """Force that cuts, by depth."""


class _Balance(NamedTuple):
    """Forces at a depth of the cut, and how far the tip is behind what it pushes."""

    contact: Contact
    behind: float


@dataclass(frozen=True)
class CoulombStep:
    """A step to a travel of the tip; the law is that of :class:`sonospline.fem.StepwiseNeedle`."""

    friction: Friction
    before: Contact
    travel: float
    dt: float
    """Seconds that it takes."""
    response: Callable[[float], tuple[Array, Array]]
    """By the depth of the cut: compliance (m + 1, m + 1) of the points and the tip, and where they go without force."""
    tolerance: float
    """Distance that is none."""

    def advance(self) -> Contact:
        """Return the contact at the end of the step."""
        depths, cut = self.friction.depths, self.before.cut
        reached = depths <= cut
        while (balance := self._balance(cut, reached)).behind < -self.tolerance:
            ahead = depths[~reached]
            far = max(cut, self.travel) + _FAR * self.tolerance - balance.behind
            end = float(ahead[0]) if len(ahead) else far
            found = self._cut(cut, end, reached, -balance.behind)
            if found is not None:
                return found.contact
            if not len(ahead):
                raise RuntimeError(f"travel = {self.travel:g}: tissue flees from the tip; give a lower cutting force")
            cut, reached = end, depths <= end
        return balance.contact

    def _cut(self, start: float, end: float, reached: Mask, lead: float) -> _Balance | None:
        """Return what holds where the cut has gone so far that the tip is at its end; None where that is beyond one."""
        from scipy.optimize import brentq

        @cache
        def cutting(cut: float) -> _Balance:
            return self._balance(cut, reached, cutting=True)

        upper = min(end, start + _GUESS * lead)
        if cutting(upper).behind < 0:
            upper = end
            if cutting(end).behind < 0:
                return None
        nearest = _NEARER * self.tolerance
        root = brentq(lambda cut: cutting(cut).behind, start, upper, xtol=nearest)
        if abs(cutting(root).behind) <= self.tolerance:
            return cutting(root)
        # Resistance jumps there: on the far side the tip rests with less than it.
        return self._balance(min(root + 2 * nearest, upper), reached)

    def _balance(self, cut: float, reached: Mask, *, cutting: bool = False) -> _Balance:
        """Forces with the cut at a depth, in this order: points lose the needle, and what slides turns kinetic.

        Both only ever happen to more points, so that it ends.
        """
        friction, before = self.friction, self.before
        touching, forward, backward = before.touching, before.sliding > 0, before.sliding < 0
        limit = self.friction.cutting(cut)
        whole, free = self.response(cut)
        beyond = free - np.append(self.travel - friction.depths - before.anchors, self.travel - cut)
        while True:
            drag = np.append(np.where(touching, self._drag, 0.0), 0.0)
            compliance, apart = _dragged(whole, beyond, drag)
            high = np.where(reached, np.where(forward, friction.kinetic, friction.static), 0.0)
            low = np.where(touching, -np.where(backward, friction.kinetic, friction.static), 0.0)
            dry = bounded_forces(compliance, apart, np.append(low, limit if cutting else 0), np.append(high, limit))
            gaps = apart + compliance @ dry
            slip, held = -gaps[:-1], dry[:-1]
            slides_on = reached & (held == high) & (slip > self.tolerance)
            slides_back = touching & (held == low) & (slip < -self.tolerance)
            lost = slides_back & (before.anchors + slip < -self.tolerance)
            softer = friction.kinetic < friction.static
            fresh = softer & ((slides_on & ~forward) | (slides_back & ~backward))
            if lost.any():
                touching = touching & ~lost
            elif fresh.any():
                forward, backward = forward | (fresh & slides_on), backward | (fresh & slides_back)
            else:
                break
        touching = touching | (held > 0)
        sliding = slides_on.astype(np.int8) - slides_back
        anchors = np.where(touching, np.maximum(before.anchors + np.where(sliding != 0, slip, 0.0), 0.0), 0.0)
        contact = Contact(cut, anchors, touching, sliding, held + drag[:-1] * slip, float(dry[-1]))
        return _Balance(contact, float(gaps[-1]))

    @property
    def _drag(self) -> Array:
        """(m,) viscous force by the slip of the step."""
        return self.friction.viscous / self.dt if self.dt > 0 else np.zeros_like(self.friction.viscous)


def _dragged(compliance: Array, apart: Array, drag: Array) -> tuple[Array, Array]:
    """Return what dry friction meets where drag resists to slip, too: (1 + C D)^-1 of both."""
    if not drag.any():
        return compliance, apart
    system = np.eye(len(drag)) + compliance * drag
    found = np.asarray(np.linalg.solve(system, np.column_stack([compliance, apart])), float)
    return found[:, :-1], found[:, -1]

"""What the needle does to elastic tissue: what every load case has, and what forces along a line share.

The paper names "localized forces and displacement constraints corresponding to shaft
friction and compressive loading at the needle tip" (Sec. IV) and gives no formula: each
case is one way to state it. Case F is friction and tip force, case D a shaft that
carries the tissue along.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from ..geometry.needle import Needle

Array = NDArray[np.float64]

MILLI = 1000.0
"""Millinewtons in a newton: kPa times square millimetres are mN."""
NEEDLE_RADIUS_MM = 0.635
"""Of an 18 gauge trocar."""
PROCESS_ZONE_MM = 3.0
"""How far from a needle's surface tissue tears and is spread, so that its force is passed on; assumed."""


class Load(ABC):
    """One load case: a body force, or displacements along the needle, or both."""

    def body_force(self, points: Array, needle: Needle, below: float = np.inf) -> Array:
        """Return the force per volume (m, 3) at points (m, 3), of a needle whose tip is so deep below a skin."""
        return np.zeros_like(points)

    def axial_displacement(self, points: Array, needle: Needle) -> Array:
        """Return the displacement (m,) along the needle that points are held at; NaN where they are free."""
        return np.full(len(points), np.nan)

    @abstractmethod
    def total_force(self, needle: Needle, below: float = np.inf) -> float:
        """Return the whole force of a needle on tissue without end, along the needle: mN for mm and kPa.

        ``below`` is how deep its tip is below a skin; by default as deep as it has gone in.

        Raises
        ------
        ValueError
            The load states displacements: their force follows from the solution.
        """

    @property
    @abstractmethod
    def finest_length(self) -> float:
        """The length a mesh has to resolve."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # every load case is a dataclass of numbers
            positive = field.name in ("width", "radius", "tip_length")
            value = _validate.number(field.name, getattr(self, field.name), positive=positive)
            object.__setattr__(self, field.name, value)


class PointForces(NamedTuple):
    """Forces at points of a needle's axis, along it."""

    along: Array
    """(n,) where, from the entry."""
    amounts: Array
    """(n,) how large."""

    def __repr__(self) -> str:
        return f"PointForces({len(self.along)} points, {self.amounts.sum():.4g} in all)"


class AxialForce(NamedTuple):
    """The force along a needle's axis: friction that is constant between places, and a force at the tip."""

    places: Array
    """(n,) along the axis, where the friction changes."""
    changes: Array
    """(n,) by how much it does, force per length; they add up to zero."""
    tip: float
    """Force at the tip."""

    def up_to(self, depth: ArrayLike) -> tuple[Array, Array]:
        """Return the friction's sum from the entry to each depth, and that of its first moment."""
        past = np.maximum(np.asarray(depth, float)[..., None] - self.places, 0.0)
        return past @ self.changes, (past * (past / 2 + self.places)) @ self.changes

    def at_points(self, depth: float, width: float) -> PointForces:
        """Return forces at points that act as this one does, once each is smoothed by a Gaussian of a width.

        Two for each piece of at most a width, which keep its sum and first moment, and of constant
        friction its second moment; one for the tip.
        """
        edges = np.linspace(0.0, depth, max(1, int(np.ceil(depth / width))) + 1)
        sums, moments = (values[1:] - values[:-1] for values in self.up_to(edges))
        held = sums != 0
        low, high, sums = edges[:-1][held], edges[1:][held], sums[held]
        middle = np.minimum(np.maximum(moments[held] / sums, low), high)
        apart = np.minimum((high - low) / np.sqrt(12), np.minimum(middle - low, high - middle))
        along = np.concatenate([middle - apart, middle + apart, [depth]])
        return PointForces(along, np.concatenate([sums / 2, sums / 2, [self.tip]]))

    def __repr__(self) -> str:
        return f"AxialForce({len(self.places)} changes of friction, {self.tip:.4g} at the tip)"


class LineLoad(Load):
    """Friction along the inserted shaft and a force at the tip, smoothed by a Gaussian of one width.

    The width is fixed, so that a field converges as the mesh is refined. With tau the position
    along the axis, d the distance from it, L the inserted length, q the friction, here the same
    along the whole shaft, P the tip force and a the width, the force per volume along the needle is

        b = exp(-d^2 / 2a^2) / (2 pi a^2) *
            { q/2 [erf(tau / a sqrt 2) - erf((tau - L) / a sqrt 2)] + P exp(-(tau - L)^2 / 2a^2) / (a sqrt(2 pi)) }

    A part of it lies beyond the faces of a box, ahead of the entry, and beside a needle within two
    widths of a wall. On the nodes of a solver's grid what lies beyond the free face is brought back by
    a mirror; what lies beyond a wall is lost.
    """

    width: float

    @abstractmethod
    def along(self, needle: Needle, below: float = np.inf) -> AxialForce:
        """Return the force along the axis of a needle: of its pose alone, and how deep its tip is below a skin."""

    @property
    def finest_length(self) -> float:
        return self.width

    def widened(self, least: float) -> LineLoad:
        """Return the load, at least so wide."""
        return self if self.width >= least else replace(self, width=least)  # type: ignore[type-var]  # a dataclass

    def total_force(self, needle: Needle, below: float = np.inf) -> float:
        """Return the whole force of a needle, along it: mN for mm and kPa."""
        force = self.along(needle, below)
        return float(force.up_to(needle.depth)[0] + force.tip)

    def body_force(self, points: Array, needle: Needle, below: float = np.inf) -> Array:
        from scipy.special import erf

        seen, force = needle.project(points), self.along(needle, below)
        across = np.exp(-0.5 * (seen.distance / self.width) ** 2) / (2 * np.pi * self.width**2)
        # Friction is a sum of steps, and a smoothed step an error function.
        passed = (seen.along[:, None] - force.places) / self.width
        shaft = 0.5 * erf(passed / np.sqrt(2)) @ force.changes
        behind = (seen.along - needle.depth) / self.width
        tip = force.tip * np.exp(-0.5 * behind**2) / (self.width * np.sqrt(2 * np.pi))
        return (across * (shaft + tip))[:, None] * needle.direction

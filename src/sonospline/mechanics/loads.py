"""What the needle does to elastic tissue: the load cases of the reference solution.

The paper names "localized forces and displacement constraints corresponding to shaft
friction and compressive loading at the needle tip" (Sec. IV) and gives no formula: each
case here is one way to state it. Case F is friction and tip force, case D a shaft that
carries the tissue along.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..geometry.needle import Needle

Array = NDArray[np.float64]

_MILLI = 1000.0
"""Millinewtons in a newton: kPa times square millimetres are mN."""
_TIE = 1e-9
"""Nodes this near to being level with an end of the shaft, in needle lengths, count as level."""


class Load(ABC):
    """One load case: a body force, or displacements along the needle, or both."""

    def body_force(self, points: Array, needle: Needle) -> Array:
        """Return the force per volume (m, 3) at points (m, 3)."""
        return np.zeros_like(points)

    def axial_displacement(self, points: Array, needle: Needle) -> Array:
        """Return the displacement (m,) along the needle that points are held at; NaN where they are free."""
        return np.full(len(points), np.nan)

    @property
    @abstractmethod
    def finest_length(self) -> float:
        """The length a mesh has to resolve."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # every load case is a dataclass of numbers
            positive = field.name in ("width", "radius", "tip_length")
            value = _validate.number(field.name, getattr(self, field.name), positive=positive)
            object.__setattr__(self, field.name, value)


class AxialForce(NamedTuple):
    """The force along a needle's axis: friction that is constant between places, and a force at the tip."""

    places: Array
    """(n,) along the axis, where the friction changes."""
    changes: Array
    """(n,) by how much it does, force per length; they add up to zero."""
    tip: float
    """Force at the tip."""


@dataclass(frozen=True)
class LineForce(Load):
    """Load case F: uniform friction along the inserted shaft and a force at the tip.

    A line force smoothed by a Gaussian of fixed width a, so that it converges as the mesh
    is refined. With tau the position along the axis, d the distance from it, L the
    inserted length, q the friction and P the tip force, the force per volume along the
    needle is

        b = exp(-d^2 / 2a^2) / (2 pi a^2) *
            { q/2 [erf(tau / a sqrt 2) - erf((tau - L) / a sqrt 2)] + P exp(-(tau - L)^2 / 2a^2) / (a sqrt(2 pi)) }

    The defaults are for the unit cube with E = 1.

    Parameters
    ----------
    friction : float, default: 0.03
        q, force per length of shaft: kPa mm (30 of which are 0.3 N/cm) where lengths are
        in mm and E in kPa. At or above zero.
    tip_force : float, default: 0.007
        P, force: mN where lengths are in mm and E in kPa. At or above zero.
    width : float, default: 0.05
        a, in the unit of the grid. Above zero.

    Raises
    ------
    ValueError
        A parameter out of range, NaN or infinite.

    Examples
    --------
    >>> from sonospline.mechanics import LineForce
    >>> LineForce.for_cube(side=100, youngs_modulus=10).friction  # mm and kPa: 0.3 N/cm
    30.0
    """

    friction: float = 0.03
    tip_force: float = 0.007
    width: float = 0.05

    @classmethod
    def for_cube(cls, side: float, youngs_modulus: float = 1.0) -> LineForce:
        """Return the load that strains a cube of another side and modulus as the default does the unit cube."""
        side = _validate.number("side", side, positive=True)
        modulus = _validate.number("youngs_modulus", youngs_modulus, positive=True)
        unit = cls()
        return cls(unit.friction * modulus * side, unit.tip_force * modulus * side**2, unit.width * side)

    @classmethod
    def physical(cls, *, friction_n_per_mm: float, tip_force_n: float, width_mm: float) -> LineForce:
        """Return the load of a friction in N/mm and a tip force in N, for lengths in mm and moduli in kPa.

        Examples
        --------
        >>> from sonospline.mechanics import LineForce
        >>> LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5)
        LineForce(friction=30.0, tip_force=700.0, width=5.0)
        """
        friction = _validate.number("friction_n_per_mm", friction_n_per_mm)
        force = _validate.number("tip_force_n", tip_force_n)
        return cls(_MILLI * friction, _MILLI * force, _validate.number("width_mm", width_mm, positive=True))

    @property
    def finest_length(self) -> float:
        return self.width

    def along(self, needle: Needle) -> AxialForce:
        """Return the force along the axis of a needle."""
        return AxialForce(np.array([0.0, needle.depth]), np.array([self.friction, -self.friction]), self.tip_force)

    def body_force(self, points: Array, needle: Needle) -> Array:
        from scipy.special import erf

        seen, force = needle.project(points), self.along(needle)
        across = np.exp(-0.5 * (seen.distance / self.width) ** 2) / (2 * np.pi * self.width**2)
        # Friction is a sum of steps, and a smoothed step an error function.
        passed = (seen.along[:, None] - force.places) / self.width
        shaft = 0.5 * erf(passed / np.sqrt(2)) @ force.changes
        behind = (seen.along - needle.depth) / self.width
        tip = force.tip * np.exp(-0.5 * behind**2) / (self.width * np.sqrt(2 * np.pi))
        return (across * (shaft + tip))[:, None] * needle.direction


@dataclass(frozen=True)
class ShaftDisplacement(Load):
    """Load case D: tissue at the shaft is carried along the needle, and free to move across it.

    Nodes within ``radius`` of the inserted shaft are displaced along the needle by
    ``shaft``, those of them in the last ``tip_length`` before the tip by ``tip``. The
    held nodes change with the mesh, so this case does not converge as case F does: it is
    a cross-check. The defaults are for the unit cube.

    Parameters
    ----------
    shaft : float, default: 0.0227
        Displacement along the shaft, in the unit of the grid. At or above zero.
    tip : float, default: 0.0266
        Displacement just behind the tip, in the unit of the grid. At or above zero.
    radius : float, default: 0.03
        Nodes this near to the axis are held. Above zero.
    tip_length : float, default: 0.06
        Length of the part that moves by ``tip``. Above zero.

    Raises
    ------
    ValueError
        A parameter out of range, NaN or infinite.

    Examples
    --------
    >>> from sonospline.mechanics import ShaftDisplacement
    >>> ShaftDisplacement.for_cube(side=100).radius
    3.0
    """

    shaft: float = 0.0227
    tip: float = 0.0266
    radius: float = 0.03
    tip_length: float = 0.06

    @classmethod
    def for_cube(cls, side: float) -> ShaftDisplacement:
        """Return the default with every length multiplied by the side of a cube."""
        side = _validate.number("side", side, positive=True)
        unit = cls()
        return cls(*(getattr(unit, field.name) * side for field in fields(cls)))

    @property
    def finest_length(self) -> float:
        return self.radius

    def axial_displacement(self, points: Array, needle: Needle) -> Array:
        seen = needle.project(points)
        slack = _TIE * needle.depth
        held = (seen.along >= -slack) & (seen.along <= needle.depth + slack) & (seen.distance <= self.radius)
        near_tip = seen.along >= needle.depth - self.tip_length - slack
        return np.where(held, np.where(near_tip, self.tip, self.shaft), np.nan)

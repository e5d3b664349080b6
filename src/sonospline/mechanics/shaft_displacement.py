"""Load case D: a shaft that carries the tissue along."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..geometry.needle import Needle
from .loads import Load

Array = NDArray[np.float64]

_TIE = 1e-9
"""Nodes this near to being level with an end of the shaft, in needle lengths, count as level."""


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

    def total_force(self, needle: Needle, below: float = np.inf) -> float:
        raise ValueError("a ShaftDisplacement states no force; solve for it, or give a LineForce")

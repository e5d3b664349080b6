"""Load case F: one friction along the shaft, and a force at the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _validate
from ..geometry.needle import Needle
from .loads import MILLI, AxialForce, LineLoad


@dataclass(frozen=True)
class LineForce(LineLoad):
    """Load case F: uniform friction along the inserted shaft and a force at the tip.

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
        return cls(MILLI * friction, MILLI * force, _validate.number("width_mm", width_mm, positive=True))

    def along(self, needle: Needle) -> AxialForce:
        """Return the force along the axis of a needle."""
        return AxialForce(np.array([0.0, needle.depth]), np.array([self.friction, -self.friction]), self.tip_force)

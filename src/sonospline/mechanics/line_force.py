"""Load case F: one friction along the shaft, and a force at the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _validate
from ..geometry.needle import Needle
from .first_touch import BUILD_UP_MM, built_up
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
    build_up : float, default: 0.0
        Depth below the free face over which P builds up from nothing, in the unit of the grid (see
        :func:`~sonospline.mechanics.built_up`). At or above zero, where the whole acts at once.

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
    build_up: float = 0.0

    @classmethod
    def for_cube(cls, side: float, youngs_modulus: float = 1.0) -> LineForce:
        """Return the load that strains a cube of another side and modulus as the default does the unit cube."""
        side = _validate.number("side", side, positive=True)
        modulus = _validate.number("youngs_modulus", youngs_modulus, positive=True)
        unit = cls()
        lengths = unit.width * side, unit.build_up * side
        return cls(unit.friction * modulus * side, unit.tip_force * modulus * side**2, *lengths)

    @classmethod
    def physical(
        cls, *, friction_n_per_mm: float, tip_force_n: float, width_mm: float, build_up_mm: float = BUILD_UP_MM
    ) -> LineForce:
        """Return the load of a friction in N/mm and a tip force in N, for lengths in mm and moduli in kPa.

        Examples
        --------
        >>> from sonospline.mechanics import LineForce
        >>> LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5)
        LineForce(friction=30.0, tip_force=700.0, width=5.0, build_up=30.0)
        """
        friction = _validate.number("friction_n_per_mm", friction_n_per_mm)
        force = _validate.number("tip_force_n", tip_force_n)
        width = _validate.number("width_mm", width_mm, positive=True)
        return cls(MILLI * friction, MILLI * force, width, _validate.number("build_up_mm", build_up_mm))

    def along(self, needle: Needle, below: float = np.inf) -> AxialForce:
        """Return the force along the axis of a needle, the same in any tissue."""
        tip = self.tip_force * built_up(min(needle.depth, below), self.build_up)
        return AxialForce(np.array([0.0, needle.depth]), np.array([self.friction, -self.friction]), tip)

"""The load of a needle that meets different friction in different tissues."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..fem.loads import LineForce
from ..needle import Needle
from .tissue_map import TissueMap

Array = NDArray[np.float64]

_PIECES_PER_WIDTH = 4


@dataclass(frozen=True, eq=False)
class TissueForce(LineForce):
    """Friction along the shaft and force at the tip, each of the tissue that is there.

    The line force of :class:`~sonospline.fem.LineForce` with a friction that changes along
    the axis; forces are in mN (lengths in mm, moduli in kPa).

    Parameters
    ----------
    tissues : TissueMap
        Friction in N/mm and cutting force in N by place.
    width : float, default: 5.0
        Of the Gaussian that smooths the line, mm.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.elastic import TissueForce, scene
    >>> load = TissueForce(tissues=scene("layers", side=100))
    >>> needle = ss.Needle(entry=(0, 50, 50), tip=(60, 50, 50))
    >>> round(load.total(needle), 6)      # 0.03 N/mm over 60 mm, and 0.7 N at the tip
    2500.0
    """

    friction: float = 0.0
    tip_force: float = 0.0
    width: float = 5.0
    tissues: TissueMap | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.tissues, TissueMap):
            raise ValueError(f"tissues = {self.tissues!r} is not a TissueMap; make one, e.g. scene('layers')")
        object.__setattr__(self, "width", _validate.number("width", self.width, positive=True))

    def body_force(self, points: Array, needle: Needle) -> Array:
        from scipy.special import erf

        seen = needle.project(points)
        across = np.exp(-0.5 * (seen.distance / self.width) ** 2) / (2 * np.pi * self.width**2)
        ends, friction, tip_force = self._along(needle)
        # Each piece of constant friction contributes the difference of two error functions.
        steps = np.diff(friction, prepend=0.0, append=0.0)
        kept = steps != 0
        shaft = 0.5 * erf((seen.along[:, None] - ends[kept]) / (self.width * np.sqrt(2))) @ steps[kept]
        behind = (seen.along - needle.depth) / self.width
        tip = tip_force * np.exp(-0.5 * behind**2) / (self.width * np.sqrt(2 * np.pi))
        return (across * (shaft + tip))[:, None] * needle.direction

    def total(self, needle: Needle) -> float:
        """Return the whole force on the needle at a pose, in mN."""
        ends, friction, tip_force = self._along(needle)
        return float(friction @ np.diff(ends) + tip_force)

    def _along(self, needle: Needle) -> tuple[Array, Array, float]:
        """Ends (n + 1,) of pieces along the shaft, friction (n,) of each and force at the tip."""
        assert self.tissues is not None
        pieces = max(1, int(np.ceil(needle.depth / self.width * _PIECES_PER_WIDTH)))
        ends = np.linspace(0, needle.depth, pieces + 1)
        middles = needle.at((np.arange(pieces) + 0.5) / pieces)
        met = self.tissues.at(np.vstack([middles, needle.tip]))
        friction = np.array([material.friction_n_per_mm for material in met[:-1]])
        return ends, 1000 * friction, 1000 * met[-1].cutting_force_n

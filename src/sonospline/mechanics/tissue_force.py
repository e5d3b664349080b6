"""The load of a needle that meets different friction in different tissues."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _validate
from .._shown import shown
from ..geometry.needle import Needle
from .loads import MILLI, AxialForce, LineLoad
from .tissue_map import TissueMap

_PIECES_PER_WIDTH = 4


@dataclass(frozen=True, eq=False)
class TissueForce(LineLoad):
    """Friction along the shaft and force at the tip, each of the tissue that is there.

    A :class:`~sonospline.mechanics.LineLoad` with a friction that changes along the axis; forces
    are in mN (lengths in mm, moduli in kPa).

    Parameters
    ----------
    tissues : TissueMap
        Friction in N/mm and cutting force in N by place.
    width : float, default: 5.0
        Of the Gaussian that smooths the line, mm.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.mechanics import TissueForce
    >>> from sonospline.mechanics import labelled_cube
    >>> load = TissueForce(tissues=labelled_cube("layers", side=100))
    >>> needle = ss.Needle(entry=(0, 50, 50), tip=(60, 50, 50))
    >>> round(load.total_force(needle), 6)      # 0.03 N/mm over 60 mm, and 0.7 N at the tip
    2500.0
    """

    tissues: TissueMap
    width: float = 5.0

    def __post_init__(self) -> None:
        if not isinstance(self.tissues, TissueMap):
            raise ValueError(
                f"tissues = {shown(self.tissues)} is not a TissueMap; make one, e.g. labelled_cube('layers')"
            )
        object.__setattr__(self, "width", _validate.number("width", self.width, positive=True))

    def along(self, needle: Needle) -> AxialForce:
        """Return the force along the axis of a needle: pieces of a quarter of the width, each in one tissue."""
        pieces = max(1, int(np.ceil(needle.depth / self.width * _PIECES_PER_WIDTH)))
        places = np.linspace(0, needle.depth, pieces + 1)
        middles = needle.at((np.arange(pieces) + 0.5) / pieces)
        friction, cutting = self.tissues.resistance(np.vstack([middles, needle.tip]))
        changes = np.diff(MILLI * friction[:-1], prepend=0.0, append=0.0)
        kept = changes != 0
        return AxialForce(places[kept], changes[kept], float(MILLI * cutting[-1]))

    def __repr__(self) -> str:
        return f"TissueForce({self.tissues!r}, width={self.width:.4g})"

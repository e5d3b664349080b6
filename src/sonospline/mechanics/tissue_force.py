"""The load of a needle that meets different friction in different tissues."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _validate
from .._shown import shown
from ..geometry.needle import Needle
from .first_touch import BUILD_UP_MM, along_bevel, built_up
from .loads import MILLI, NEEDLE_RADIUS_MM, PROCESS_ZONE_MM, AxialForce, LineLoad
from .tissue_map import TissueMap

_PIECES_PER_WIDTH = 16


@dataclass(frozen=True, eq=False)
class TissueForce(LineLoad):
    """Friction along the shaft and force at the tip, each of the tissue that the label map has there.

    Where tissue has moved, the map is asked at the needle's own place all the same: asked where the tissue was, a stiff
    layer that is pushed past the tip would let it go and come back, with no force that is in equilibrium.

    A :class:`~sonospline.mechanics.LineLoad` with a friction that changes along the axis; forces
    are in mN (lengths in mm, moduli in kPa).

    Parameters
    ----------
    tissues : TissueMap
        Friction in N/mm and cutting force in N by place.
    width : float, default: 3.635
        Of the Gaussian that smooths the line, mm: the radius of an 18 gauge needle and the process zone around it.
    build_up : float, default: 20.0
        Depth over which the cutting force builds up from nothing, mm (see :func:`~sonospline.mechanics.built_up`).
        At or above zero, where the whole acts at once.

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
    width: float = NEEDLE_RADIUS_MM + PROCESS_ZONE_MM
    build_up: float = BUILD_UP_MM

    def __post_init__(self) -> None:
        if not isinstance(self.tissues, TissueMap):
            raise ValueError(
                f"tissues = {shown(self.tissues)} is not a TissueMap; make one, e.g. labelled_cube('layers')"
            )
        object.__setattr__(self, "width", _validate.number("width", self.width, positive=True))
        object.__setattr__(self, "build_up", _validate.number("build_up", self.build_up))

    def along(self, needle: Needle) -> AxialForce:
        """Return the force along the axis of a needle: pieces of a sixteenth of the width, each in one tissue.

        A piece is of the tissue where it begins, and begins at the same place whatever the depth; the cutting
        force is the mean over the tip's bevel, 6 mm long. So the force changes with the depth without a jump.
        """
        piece = self.width / _PIECES_PER_WIDTH
        begins = piece * np.arange(max(1, int(np.ceil(needle.depth / piece))))
        bevel, shares = along_bevel(needle.depth)
        friction, cutting = self.tissues.resistance(needle.at(np.append(begins, bevel) / needle.depth))
        between = np.zeros(len(begins) + 2)  # nothing before the entry and past the tip
        between[1:-1] = MILLI * friction[: len(begins)]
        changes = between[1:] - between[:-1]
        kept = changes != 0
        places = np.append(begins, needle.depth)
        tip = MILLI * built_up(needle.depth, self.build_up) * float(cutting[len(begins) :] @ shares)
        return AxialForce(places[kept], changes[kept], tip)

    def __repr__(self) -> str:
        return f"TissueForce({self.tissues!r}, width={self.width:.4g}, build_up={self.build_up:.4g})"

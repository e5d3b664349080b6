"""The load of a needle that meets different friction in different tissues."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _validate
from .._shown import shown
from ..geometry.needle import Needle
from .first_touch import BUILD_UP_MM, along_bevel, built_up
from .loads import MILLI, NEEDLE_RADIUS_MM, PROCESS_ZONE_MM, AxialForce, LineLoad
from .material import FLUID_SHEAR, Material
from .tissue_map import TissueMap

SHEAR = 0.4
"""Of tissue around a tip, at most. Friction of the assumed tissues shears by 0.3 to 0.5 beside it: together they stay
below one, where a linear theory folds."""
CARRIED_MM = 20.0
"""How far behind a tip what it loads may have come from: tissue goes along by 10 mm, and the force acts over widths."""
_SHEAR_OF_A_FORCE = 0.01344
"""Largest shear, du/dx across the force, over F / (G w^2): Kelvin's solution under a Gaussian, Poisson's ratio 0.45."""
_PIECES_PER_WIDTH, _PIECE_MM = 16, 0.25


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
    build_up : float, default: 30.0
        Depth below the skin over which the cutting force builds up from nothing, mm (see
        :func:`~sonospline.mechanics.built_up`). At or above zero, where the whole acts at once.

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

    def along(self, needle: Needle, below: float = np.inf) -> AxialForce:
        """Return the force along the axis of a needle: pieces of a sixteenth of the width, each in one tissue.

        A piece is of the tissue where it begins, and begins at the same place whatever the depth; the cutting
        force is the mean over the tip's bevel, 6 mm long, and at most what the tissue that the tip has carried along
        holds, see :func:`carried_by`. So the force changes with the depth without a jump.
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
        tip = MILLI * built_up(min(needle.depth, below), self.build_up) * float(cutting[len(begins) :] @ shares)
        tip = min(tip, carried_by(self.tissues, needle))
        return AxialForce(places[kept], changes[kept], tip)

    def __repr__(self) -> str:
        return f"TissueForce({self.tissues!r}, width={self.width:.4g}, build_up={self.build_up:.4g})"


def carried_by(tissues: TissueMap, needle: Needle) -> float:
    """Return the largest force in mN that the tissue at a needle's tip carries along.

    Of an 18 gauge needle, whatever a solver's cells can take of the load: on any grid it is the same.

    What a tip holds was some millimetres behind before it moved: soft tissue is at the place of a thin stiff layer
    before the layer is pierced. Each tissue carries what shears it by 0.4, and in any case the force that cuts it.
    Tissues one after the other on the last 20 mm give way one by one: harmonic mean.
    """
    pieces = np.arange(max(0, int((needle.depth - CARRIED_MM) / _PIECE_MM)), int(np.ceil(needle.depth / _PIECE_MM)))
    begins = _PIECE_MM * pieces
    lengths = np.minimum(begins + _PIECE_MM, needle.depth) - np.maximum(begins, needle.depth - CARRIED_MM)
    labels, which = np.unique(tissues.labels_at(needle.at(begins / needle.depth)), return_inverse=True)
    gives_way = np.array([1 / _carries(tissues.materials[int(label)]) for label in labels])
    return float(lengths.sum() / (lengths @ gives_way[which]))


def _carries(material: Material) -> float:
    """Force in mN; a fluid is taken for the solid that it keeps the volume of."""
    shear = material.shear_modulus / (FLUID_SHEAR if material.fluid else 1.0)
    return max(
        SHEAR * shear * (NEEDLE_RADIUS_MM + PROCESS_ZONE_MM) ** 2 / _SHEAR_OF_A_FORCE, MILLI * material.cutting_force_n
    )

"""The load of a needle of which nothing is said."""

from __future__ import annotations

from ..geometry.tissue import Tissue
from .line_force import LineForce
from .loads import LineLoad
from .material import Material
from .tissue_force import TissueForce
from .tissue_map import TissueMap

_WIDTH = LineForce().width
"""In sides of the tissue."""


def default_load(tissue: Tissue, material: Material | TissueMap) -> LineLoad:
    """Return the friction and the cutting force of what a tissue is made of, smoothed over a twentieth of its side.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.mechanics import Material, default_load
    >>> default_load(ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5)), Material(stiffness_kpa=10))
    LineForce(friction=30.0, tip_force=700.0, width=5.0)
    """
    width = _WIDTH * tissue.grid.side
    if isinstance(material, TissueMap):
        return TissueForce(tissues=material, width=width)
    return LineForce.physical(
        friction_n_per_mm=material.friction_n_per_mm, tip_force_n=material.cutting_force_n, width_mm=width
    )

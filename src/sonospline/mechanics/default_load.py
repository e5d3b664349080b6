"""The load of a needle of which nothing is said but how thick it is."""

from __future__ import annotations

from .. import _validate
from .first_touch import BUILD_UP_MM
from .line_force import LineForce
from .loads import NEEDLE_RADIUS_MM, PROCESS_ZONE_MM, LineLoad
from .material import Material
from .tissue_force import TissueForce
from .tissue_map import TissueMap


def default_load(
    material: Material | TissueMap,
    *,
    needle_radius_mm: float = NEEDLE_RADIUS_MM,
    process_zone_mm: float = PROCESS_ZONE_MM,
    build_up_mm: float = BUILD_UP_MM,
) -> LineLoad:
    """Return the friction and the cutting force of what a tissue is made of, smoothed over the needle's surroundings.

    Parameters
    ----------
    material : Material or TissueMap
        Friction and cutting force.
    needle_radius_mm : float, default: 0.635
        Of the shaft; by default that of an 18 gauge trocar.
    process_zone_mm : float, default: 3.0
        How far from its surface tissue tears and is spread: the force is passed on from there. Assumed.
    build_up_mm : float, default: 30.0
        Depth below the skin over which the cutting force builds up, from nothing at first touch.

    Examples
    --------
    >>> from sonospline.mechanics import Material, default_load
    >>> default_load(Material(stiffness_kpa=10))
    LineForce(friction=30.0, tip_force=700.0, width=3.635, build_up=30.0)
    """
    radius = _validate.number("needle_radius_mm", needle_radius_mm, positive=True)
    width = radius + _validate.number("process_zone_mm", process_zone_mm)
    build_up_mm = _validate.number("build_up_mm", build_up_mm)
    if isinstance(material, TissueMap):
        return TissueForce(tissues=material, width=width, build_up=build_up_mm)
    return LineForce.physical(
        friction_n_per_mm=material.friction_n_per_mm, tip_force_n=material.cutting_force_n, width_mm=width,
        build_up_mm=build_up_mm,
    )  # fmt: skip

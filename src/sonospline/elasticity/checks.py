"""What a solver can be given: materials, and loads that are forces."""

from __future__ import annotations

from typing import Any

from .._shown import shown
from ..mechanics.loads import Load
from ..mechanics.material import Material
from ..mechanics.shaft_displacement import ShaftDisplacement
from ..mechanics.tissue_map import TissueMap


def check_material(material: Any) -> Material | TissueMap:
    """Return what tissue is made of, or raise ValueError where it is something else."""
    if not isinstance(material, Material | TissueMap):
        raise ValueError(f"material = {shown(material)} is none; give a Material, or a TissueMap for labels")
    return material


def check_force(load: Load) -> Load:
    """Return a load that is a force.

    Raises
    ------
    ValueError
        It is none.
    """
    if not isinstance(load, Load) or isinstance(load, ShaftDisplacement):
        raise ValueError(f"load = {shown(load)} is no force; give a LineForce (or a FiniteElementModel this load)")
    return load

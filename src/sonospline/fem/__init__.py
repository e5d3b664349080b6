"""Finite element reference solutions: what the spline is measured against.

Linear elasticity on the tissue's own nodes, with two load cases and two engines. Needs the
extra ``fem``; the engine ``"fenicsx"`` needs DOLFINx, in this or in another Python.
"""

from .engine import StepTimes
from .history import history_of, reference_history
from .loads import LineForce, Load, ShaftDisplacement
from .material import CellMaterial, Material
from .model import FiniteElementModel

__all__ = [
    "CellMaterial",
    "FiniteElementModel",
    "LineForce",
    "Load",
    "Material",
    "ShaftDisplacement",
    "StepTimes",
    "history_of",
    "reference_history",
]

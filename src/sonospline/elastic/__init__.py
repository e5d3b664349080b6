"""Elastic tissue in real time: stiffness by place, loads in physical units, error estimates.

Linear finite elements on a grid of their own, one warm-started multigrid iteration a frame.
"""

from .insertion import ElasticInsertion
from .materials import MaterialTable, TissueMaterial
from .moduli import Moduli
from .scenes import SCENES, scene
from .solver import ElasticSolver, ElasticState, NotConvergedError
from .solver_grid import solver_grid
from .strain import Strain, largest_strain
from .tissue_force import TissueForce
from .tissue_map import TissueMap

__all__ = [
    "SCENES",
    "ElasticInsertion",
    "ElasticSolver",
    "ElasticState",
    "MaterialTable",
    "Moduli",
    "NotConvergedError",
    "Strain",
    "TissueForce",
    "TissueMap",
    "TissueMaterial",
    "largest_strain",
    "scene",
    "solver_grid",
]

"""The models of tissue a session can switch between, each made when it is first asked for."""

from __future__ import annotations

from ..mechanics.line_force import LineForce
from ..mechanics.material import Material
from ..models.elastic import ElasticInsertion
from ..models.insertion import NeedleInsertion
from ..models.kelvinlet import DragModel, KelvinletInsertion
from ..models.spline.insertion import Insertion
from .scene import Scene

SETTLED = 5e-4
"""Error estimate, relative to the field, at which elastic tissue has come to rest."""


def make(name: str, scene: Scene) -> NeedleInsertion:
    """Return a model's insertion into a scene's tissue."""
    part, tissue = scene.spec.model, scene.tissue
    if name == "paper":
        return Insertion(tissue)
    if name == "kelvinlet":
        drag = DragModel.kelvinlet(tissue.grid.side, drag=part.drag_mm, poissons_ratio=part.poissons_ratio)
        return KelvinletInsertion(tissue, drag)
    if scene.tissues is not None:
        return ElasticInsertion(tissue, scene.tissues, nodes=part.solver_nodes)
    material = Material(scene.spec.tissue.stiffness_kpa, part.poissons_ratio)
    width = LineForce().width * tissue.grid.side
    load = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=width)
    return ElasticInsertion(tissue, material, load, nodes=part.solver_nodes)


def settled(insertion: NeedleInsertion) -> bool:
    """Return whether another step at the same pose would change nothing to speak of."""
    return not isinstance(insertion, ElasticInsertion) or insertion.solution.error <= SETTLED

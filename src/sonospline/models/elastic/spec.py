"""The elastic model as the registry offers it; what computes is imported when a model is made."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..option import Option
from ..registry import ModelSpec
from .state import ABLE, BUDGET, TOLERANCE

if TYPE_CHECKING:
    from ...geometry.tissue import Tissue
    from ...mechanics.material import Material
    from ...mechanics.tissue_map import TissueMap
    from .model import ElasticModel


def _make(
    tissue: Tissue, materials: Material | TissueMap, *, solver_nodes: int, tolerance: float, budget: int
) -> ElasticModel:
    from .model import ElasticModel

    return ElasticModel(tissue, materials, nodes=solver_nodes, tolerance=tolerance, budget=budget)


SPEC = ModelSpec(
    name="elastic",
    title="Elastic",
    summary="live finite elements on label maps, in N and kPa",
    maker=_make,
    options=(
        Option(name="solver_nodes", kind="whole", default=25**3, low=8, high=10**10, live=(1000, 200_000),
               help="nodes of the elastic solver, about"),
        Option(name="tolerance", default=TOLERANCE, low=1e-5, high=1, live=(1e-3, 1),
               help="error of the field at which a step ends"),
        Option(name="budget", kind="whole", default=BUDGET, low=1, high=200, live=(1, 100),
               help="iterations of a step, at most"),
    ),
    capabilities=ABLE,
    properties=("stiffness_kpa", "poissons_ratio"),
)  # fmt: skip

"""Elastic tissue, live: finite elements on labelled or uniform tissue, iterated at every step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ...mechanics.loads import LineForce, Load
from ...mechanics.material import Material
from ...mechanics.tissue_force import TissueForce
from ...mechanics.tissue_map import TissueMap
from ..contract import NeedleForce, Response, State, TissueModel
from ..option import Option
from ..registry import ModelSpec
from .load_vector import nodal_load
from .solver import ElasticSolver, ElasticState

Single = NDArray[np.float32]

SETTLED = 5e-4
"""Error estimate at which tissue has come to rest."""
_NEWTONS = 1e-3
"""In a kPa times a square millimetre."""
_WIDTH = LineForce().width
"""Of a needle's load, in sides of the tissue."""


@dataclass(frozen=True, eq=False, repr=False)
class ElasticTissueState(State):
    """The needles, and the displacement so far."""

    solution: ElasticState = field(kw_only=True)


class ElasticModel(TissueModel):
    """Linear elastic tissue under the friction and the tip force of needles, in mm, kPa and N.

    Parameters
    ----------
    tissue : Tissue
        The display grid and its free face.
    material : Material or TissueMap
        One stiffness everywhere, or labelled tissue.
    load : Load, optional
        What a needle does; by default :func:`default_load`.
    nodes : int, default: 15625
        Nodes of the solver's grid, about.
    integration : {"mean_dilatation", "full"}, default: "mean_dilatation"
        As for :class:`ElasticSolver`.
    """

    name = "elastic"
    capabilities = frozenset({"forces", "time", "labels", "several needles"})

    def __init__(
        self,
        tissue: Tissue,
        material: Material | TissueMap,
        load: Load | None = None,
        *,
        nodes: int = 25**3,
        integration: str = "mean_dilatation",
    ) -> None:
        super().__init__(tissue)
        self.solver = ElasticSolver(tissue, material, nodes=nodes, integration=integration)
        self.load = default_load(tissue, material) if load is None else load

    @property
    def rest(self) -> ElasticTissueState:
        """The state without a needle."""
        return ElasticTissueState(self.identity, solution=self.solver.rest)

    def _options(self) -> tuple[Any, ...]:
        return self.solver.material, self.solver.grid, self.solver.integration, self.load

    def _answer(self, state: State, needles: dict[str, Needle], dt: float) -> Response:
        assert isinstance(state, ElasticTissueState)
        loads = {name: nodal_load(self.load, needle, self.solver.grid) for name, needle in needles.items()}
        total = sum(loads.values(), start=np.zeros_like(self.solver.rest.load))
        solution = self.solver.advance(state.solution, total) if needles else self.solver.rest
        return Response(
            state=ElasticTissueState(self.identity, tuple(needles.items()), solution=solution),
            field=self.solver.field(solution),
            forces={name: self._force(loads[name], needle) for name, needle in needles.items()},
            error_estimate=solution.error,
            settled=solution.error <= SETTLED,
        )

    def _force(self, load: Single, needle: Needle) -> NeedleForce:
        total = self.solver.grid.direction @ load.sum(axis=(1, 2, 3), dtype=np.float64)
        return NeedleForce.along(needle.direction, _NEWTONS * total)


def default_load(tissue: Tissue, material: Material | TissueMap) -> Load:
    """Return the load of a needle of which nothing is said.

    In labelled tissue the friction and the cutting force of each; in uniform tissue those that
    strain its box as :class:`~sonospline.mechanics.LineForce` strains the unit cube.
    """
    if isinstance(material, TissueMap):
        return TissueForce(tissues=material, width=_WIDTH * tissue.grid.side)
    return LineForce.for_cube(tissue.grid.side, material.youngs_modulus)


def _make(tissue: Tissue, materials: Material | TissueMap, *, solver_nodes: int) -> ElasticModel:
    load = None
    if isinstance(materials, Material):
        load = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=_WIDTH * tissue.grid.side)
    return ElasticModel(tissue, materials, load, nodes=solver_nodes)


SPEC = ModelSpec(
    name="elastic",
    title="Elastic",
    summary="live finite elements on label maps, in N, kPa and s",
    maker=_make,
    options=(
        Option(name="solver_nodes", kind="whole", default=25**3, low=8, high=10**10, help="solver grid, about"),
    ),
    capabilities=ElasticModel.capabilities,
    properties=("stiffness_kpa", "poissons_ratio"),
)  # fmt: skip

"""Elastic tissue, live: finite elements on labelled or uniform tissue, iterated at every step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import _validate
from ...fields.grid_field import GridField
from ...fields.strain import largest_strain
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ...mechanics.default_load import default_load
from ...mechanics.loads import MILLI, Load
from ...mechanics.material import Material
from ...mechanics.tissue_map import TissueMap
from ..contract import NeedleForce, Response, State, TissueModel
from .solver import SETTLED, ElasticSolver
from .state import ABLE, BUDGET, TOLERANCE, ElasticState

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False, repr=False)
class ElasticTissueState(State):
    """The needles, and the displacement so far."""

    solution: ElasticState = field(kw_only=True)


class ElasticModel(TissueModel):
    """Linear elastic tissue under the friction and the tip force of needles, in mm, kPa and N.

    Quasi-static: the answer is that of the pose, whatever the time. A step iterates until the error
    estimate is at most ``tolerance`` or ``budget`` iterations are done, so that a field depends
    little on the steps that led to it; each field says how little.
    Tissue that is left alone comes to rest: further steps at the same pose go on to an error of
    5e-4 and then change nothing.

    Parameters
    ----------
    tissue : Tissue
        The display grid and its free face.
    material : Material or TissueMap
        One stiffness everywhere, or labelled tissue.
    load : Load, optional
        What a needle does; by default :func:`~sonospline.mechanics.default_load`.
    nodes : int, default: 15625
        Nodes of the solver's grid, about.
    integration : {"mean_dilatation", "full"}, default: "mean_dilatation"
        As for :class:`ElasticSolver`.
    tolerance : float, default: 0.05
        Error estimate, relative to the field, at which a step ends.
    budget : int, default: 12
        Iterations of a step, at most.

    Raises
    ------
    ValueError
        As :class:`ElasticSolver`, or a tolerance or budget out of range.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.models.elastic import ElasticModel
    >>> from sonospline.mechanics import labelled_cube
    >>> tissue = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
    >>> model = ElasticModel(tissue, labelled_cube("layers", side=100, stiffness_kpa=10), nodes=13**3)
    >>> needles = {"biopsy": ss.Needle((0, 40, 50), (60, 40, 50)), "probe": ss.Needle((0, 70, 50), (30, 70, 50))}
    >>> response = model.step(model.rest, needles)
    >>> round(response.forces["biopsy"].axial_n, 1), round(response.forces["probe"].axial_n, 1)
    (2.4, 1.5)
    """

    name = "elastic"
    capabilities = ABLE

    def __init__(
        self,
        tissue: Tissue,
        material: Material | TissueMap,
        load: Load | None = None,
        *,
        nodes: int = 25**3,
        integration: str = "mean_dilatation",
        tolerance: float = TOLERANCE,
        budget: int = BUDGET,
    ) -> None:
        super().__init__(tissue)
        self.solver = ElasticSolver(tissue, material, nodes=nodes, integration=integration)
        self.load = default_load(tissue, material) if load is None else load
        self.tolerance = _validate.number("tolerance", tolerance, positive=True)
        self.budget = _validate.count("budget", budget)

    @property
    def rest(self) -> ElasticTissueState:
        """The state without a needle."""
        return ElasticTissueState(self.identity, solution=self.solver.rest)

    def _options(self) -> tuple[Any, ...]:
        solver = self.solver
        return solver.material, solver.grid, solver.integration, self.load, self.tolerance, self.budget

    def _answer(self, state: State, needles: dict[str, Needle], dt: float) -> Response:
        assert isinstance(state, ElasticTissueState)
        loads = {name: self.solver.nodal_load(self.load, needle) for name, needle in needles.items()}
        total = sum(loads.values(), start=np.zeros_like(self.solver.rest.load))
        solution = self.solver.advance(state.solution, total, tolerance=self.tolerance, budget=self.budget)
        forces = {name: self._force(loads[name], needle) for name, needle in needles.items()}
        return self._response(ElasticTissueState(self.identity, tuple(needles.items()), solution=solution), forces)

    def settle(self, response: Response, *, tolerance: float = 5e-3) -> Response:
        """Return a response of the same pose whose error estimate is at most ``tolerance``.

        Raises
        ------
        ValueError
            A response of another model, or a tolerance below 1e-6.
        NotConvergedError
            It does not get there.
        """
        state = response.state
        self._check_state(state)
        assert isinstance(state, ElasticTissueState)
        solution = self.solver.settle(state.solution, tolerance=tolerance)
        return self._response(replace(state, solution=solution), response.forces)

    def facts(self, response: Response) -> dict[str, Any]:
        """The solver's grid, the range of stiffness, the error, and where the strain is largest."""
        assert isinstance(response.field, GridField)
        strain, moduli = largest_strain(response.field), self.solver.moduli
        young = moduli.shear * (3 * moduli.lame + 2 * moduli.shear) / (moduli.lame + moduli.shear)
        return {
            "solver_shape": self.solver.grid.shape,
            "young_kpa": [float(young.min()), float(young.max())],
            "error_estimate": response.error_estimate,
            "largest_strain": strain.largest,
            "largest_strain_ras_mm": strain.place.tolist(),
            "small_strain": strain.small,
        }

    def _response(self, state: ElasticTissueState, forces: Mapping[str, NeedleForce]) -> Response:
        return Response(
            state=state,
            field=self.solver.field(state.solution),
            forces=forces,
            error_estimate=state.solution.error,
            settled=state.solution.measured and state.solution.error <= SETTLED,
        )

    def _force(self, load: Single, needle: Needle) -> NeedleForce:
        total = self.solver.grid.direction @ load.sum(axis=(1, 2, 3), dtype=np.float64)
        return NeedleForce.along(needle.direction, total / MILLI)

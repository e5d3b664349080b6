"""Needles in elastic tissue by their poses alone: loads on the tissue that they are in, and the field under them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...elasticity.solver import SETTLED, ElasticSolver
from ...elasticity.state import ElasticState
from ...geometry.needle import Needle
from .needle_loads import SMALL, Loading, NeedleLoads
from .tissue_state import ElasticTissueState

Array = NDArray[np.float64]

_LAG = 0.01
"""Error of a field, at most, from loads that are beside their needles when a step ends."""
_MOST_LOOKS = 12
"""Times that the tissue a resting needle loads is looked for: where two tissues meet there may be no end to it."""
MOST_ROUNDS = 20
"""Of a load that follows the tissue it moves, until both stay."""
_AFTER_A_LOOK = 0.7
"""Of the tolerance, what is left by a step that has looked for its tissue once more: where a load jumps between stiff
and soft tissue, an estimate is as much as a third below the error."""


class Loaded(NamedTuple):
    """Where a step has brought loads and tissue."""

    loading: Loading
    solution: ElasticState
    beside: float
    """Error of the field, relative, because loads act beside the tissue that their needles are in."""
    looks: int = 0
    """Times that the tissue was looked for since the needles came to rest."""


@dataclass(frozen=True)
class NeedlesInPose:
    """Steps of needles whose forces are those of their poses.

    Parameters
    ----------
    solver : ElasticSolver
        The tissue.
    loads : NeedleLoads
        What needles do on its nodes.
    tolerance : float
        Error of the field at which a step ends.
    budget : int
        Iterations of a step, at most; an estimate after another look costs as much as one, and counts.
    """

    solver: ElasticSolver
    loads: NeedleLoads
    tolerance: float
    budget: int

    def step(self, state: ElasticTissueState, needles: Mapping[str, Needle]) -> Loaded:
        """Bring needles to their poses: where their load is far beside them afterwards, look for their tissue again."""
        last = Loading(dict(state.needles), dict(state.shafts), {})
        most = min(_LAG, 2 * self.tolerance)
        rests = bool(last.shafts) and needles == last.needles
        ends = rests and state.looks == _MOST_LOOKS
        loading = first = self._loading(state, needles, last, ends=ends, partly=rests or state.beside > most)
        looks = min(state.looks + (loading.shafts != last.shafts), _MOST_LOOKS) if rests else 0
        solution = self._advanced(state.solution, loading, self.tolerance, self.budget)
        sought, beside = self._sought(loading, solution)
        while not ends and beside > most and (left := self.budget - solution.iterations - 1) > 0:
            loading, solution = self._again(loading, solution, left)
            sought, beside = self._sought(loading, solution)
        if not rests:
            loading = self.loads.drifting(loading, first, last, sought)
        return Loaded(loading, solution, beside, looks)

    def _loading(
        self, state: ElasticTissueState, needles: Mapping[str, Needle], last: Loading, *, ends: bool, partly: bool
    ) -> Loading:
        """The loads with which a step begins."""
        if ends:
            return self.loads.acting(needles, last.shafts)
        follow = self.loads.nearer if partly else self.loads.on
        return follow(state.solution.displacement, needles, last)

    def _again(self, loading: Loading, solution: ElasticState, left: int) -> tuple[Loading, ElasticState]:
        """Look for the tissue of needles again within a step, and go on with what is left of its budget."""
        resolved = self.tolerance / solution.left_after(left)
        loading = self.loads.nearer(solution.displacement, loading.needles, loading, resolved)
        tolerance = min(self.tolerance, max(_AFTER_A_LOOK * self.tolerance, SETTLED))  # float32 ends near there
        again = self.solver.measured(self._advanced(solution, loading, tolerance, left))
        return loading, replace(again, iterations=solution.iterations + again.iterations + 1)

    def settled(self, state: ElasticTissueState, tolerance: float) -> Loaded:
        """Iterate a state at its poses until field and loads stay."""
        needles, solution = dict(state.needles), self.solver.settle(state.solution, tolerance=tolerance)
        loading = self.loads.nearer(solution.displacement, needles, Loading(needles, dict(state.shafts), {}))
        for _ in range(MOST_ROUNDS):
            solution = self._advanced(solution, loading, self.tolerance, self.budget)
            solution = self.solver.settle(solution, tolerance=tolerance)
            _, beside = self._sought(loading, solution)
            if beside <= tolerance:
                break
            loading = self.loads.nearer(solution.displacement, needles, loading)
        return Loaded(loading, solution, beside)

    def rests(self, state: ElasticTissueState) -> bool:
        """Return whether further steps at the same poses change nothing to speak of."""
        small = state.beside <= SMALL or state.looks == _MOST_LOOKS
        return state.solution.measured and state.solution.error <= SETTLED and small

    def _sought(self, loading: Loading, solution: ElasticState) -> tuple[dict[str, Array], float]:
        """Where the tissue of needles is now, and the error of the field because their loads act beside it."""
        sought = self.loads.sought(loading, solution.displacement)
        return sought, self.loads.error(loading, sought)

    def _advanced(self, solution: ElasticState, loading: Loading, tolerance: float, budget: int) -> ElasticState:
        start = solution if solution.nearer_than_none(loading.total) else self.solver.rest
        return self.solver.advance(start, loading.total, tolerance=tolerance, budget=budget)

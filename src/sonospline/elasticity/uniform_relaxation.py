"""Tissue that relaxes alike everywhere: elastic tissue under forces that remember.

K u = F + sum J_b V_b, with V_b the forces filtered by the creep of the series. What is kept is how far each V_b lags
behind F: it falls to nothing under forces that are held, and float32 holds it to its own precision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..mechanics.relaxation import PronySeries
from .combined import combined
from .scaled import scaled
from .solver import ElasticSolver
from .state import NIL_MN, RelaxingState

Single = NDArray[np.float32]


class UniformRelaxation:
    """How tissue of one series goes on: exactly, for forces that change linearly within a step.

    Parameters
    ----------
    solver : ElasticSolver
        Of the elastic tissue.
    series : PronySeries
        Its relaxation.
    """

    def __init__(self, solver: ElasticSolver, series: PronySeries) -> None:
        self.solver = solver
        self.times_s = series.times_s
        self._creep = series.creep

    def advance(self, state: RelaxingState, forces: Single, dt: float, tolerance: float, budget: int) -> RelaxingState:
        """Return the state after dt under forces that change linearly to those given."""
        if not self.times_s:
            solution = self.solver.advance(state.solution, forces, tolerance=tolerance, budget=budget)
            return RelaxingState(solution, forces, state.history)
        lag = self._lag(state, forces, dt)
        solution = self.solver.advance(state.solution, self._felt(forces, lag, dt), tolerance=tolerance, budget=budget)
        return RelaxingState(solution, forces, lag)

    def jump(self, dt: float) -> float:
        """Return how much of the elastic answer to a change of the forces over dt tissue gives at its end."""
        return self._creep.jump(dt)

    def growth(self, state: RelaxingState, dt: float) -> float:
        """Return the part of itself that displacement grows by in dt if its forces stay, in the mean."""
        load, felt = (
            state.solution.load.ravel(),
            self._felt(state.forces, self._lag(state, state.forces, dt), dt).ravel(),
        )
        size = float(np.einsum("i,i", load, load))
        return float(np.einsum("i,i", felt, load)) / size - 1 if size > 0 else 0.0

    def effective(self, dt: float) -> ElasticSolver:
        """Return the solver of that answer."""
        return scaled(self.solver, np.full(self.solver.moduli.shear.shape, 1 / self.jump(dt)))

    def _lag(self, state: RelaxingState, forces: Single, dt: float) -> Single:
        if dt == 0:  # as below, but without rounding: what has not begun to creep moves as elastic tissue, bit for bit
            return forces - (state.forces - state.history)
        kept, ramp = self._creep.step(dt)
        change = forces - state.forces
        lag: Single = _core.active.followed(state.history, np.zeros_like(change), change, 1 - kept, ramp, NIL_MN)
        return lag

    def _felt(self, forces: Single, lag: Single, dt: float) -> Single:
        """What elastic tissue would have to feel to move as this does."""
        amounts = np.array([self._creep.amounts], np.float32)
        if dt > 0:
            return np.asarray((1 + amounts.sum()) * forces - combined(amounts, lag)[0])
        filtered = forces - lag
        return np.asarray(forces + combined(amounts, filtered)[0]) if filtered.any() else forces

    def __repr__(self) -> str:
        return f"UniformRelaxation({len(self.times_s)} terms)"

"""Tissues that relax differently: for each time constant one displacement that remembers.

Stress is C : (e - sum g_b B a_b), with fractions g_b of each cell and nodal fields a_b that follow the displacement,
da_b/dt = (u - a_b) / tau_b: K u = f + sum K_b a_b, K_b of moduli g_b C. Where u changes linearly within a step, a_b
changes by (1 - r_b) of what u does, r_b the ramp of the step: u is the answer of softer tissue, K - sum (1 - r_b) K_b.

In a frame that is K but for some per cent, and where a step is longer the operator of a step not unlike it will do,
found for few of them and only when they are needed: with a_b of the last displacement u' that was found,

    [K - sum (1 - r'_b) K_b] u = f + sum K_b (a_b - (1 - r'_b) u')

until u is u', of which the next u lacks no more than the small part that r' differs from r.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..mechanics.relaxation import ExponentialStep, PronySeries
from . import hierarchy
from .combined import combined
from .scaled import scaled
from .solver import ElasticSolver
from .state import NIL_MM, RelaxingState
from .time_parts import parts

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_NEAR = 0.1
"""Part of the change of a displacement, at most, that the operator of elastic tissue leaves; else one is made."""
_SHARE_OF_ERROR = 0.25
"""Of the error at which a step ends, that may be left because a displacement is not that of its own past."""
_LEAST = 1e-9
"""Stiffness of what does not relax, as a share, in the operators of what does: these have no holes."""


class TissueRelaxation:
    """How tissues of several series, of the same time constants, go on together.

    Parameters
    ----------
    solver : ElasticSolver
        Of the elastic tissue.
    series : sequence of PronySeries
        Different ones; elastic tissue need not be among them.
    shares : (series, cx, cy, cz) ndarray
        Of each in the cells of the solver.
    """

    def __init__(self, solver: ElasticSolver, series: Sequence[PronySeries], shares: Array) -> None:
        self.solver = solver
        self.times_s = series[0].times_s
        self._fractions = np.array([each.fractions for each in series])
        self._shares = shares
        self._solvers: dict[float, ElasticSolver] = {0.0: solver}

    def advance(self, state: RelaxingState, forces: Single, dt: float, tolerance: float, budget: int) -> RelaxingState:
        """Return the state after dt under forces that change linearly to those given."""
        before, begun, iterations = state.forces, 0.0, 0
        for end in parts(dt, min(self.times_s)):
            reached = forces if end == 1 else before + np.float32(end) * (forces - before)
            state = self._part(state, reached, (end - begun) * dt, tolerance, budget)
            begun, iterations = end, iterations + state.solution.iterations
        return replace(state, solution=replace(state.solution, iterations=iterations))

    def jump(self, dt: float) -> float:
        """Return about how much of the elastic answer to a change of the forces over dt tissue gives at its end."""
        return 1 / float(self._stiffness(self._ramp(dt)).mean())

    def growth(self, state: RelaxingState, dt: float) -> float:
        """Return what says that it takes a step to know how displacement creeps."""
        return float("inf")

    def effective(self, dt: float) -> ElasticSolver:
        """Return the solver of that answer."""
        return scaled(self.solver, self._stiffness(self._ramp(dt)))

    def _part(self, state: RelaxingState, forces: Single, dt: float, tolerance: float, budget: int) -> RelaxingState:
        """One step in which displacement is linear in time."""
        step = ExponentialStep.of(self.times_s, dt)
        forgotten, taken_up = 1 - step.kept, 1 - step.ramp
        near, has, lacks = self._nearest(step.ramp)
        last, solution, iterations = state.solution.displacement, state.solution, 0
        while True:
            guess = solution.displacement
            load = self._load(forces, state.history, (1 - forgotten, forgotten - taken_up, taken_up - has), last, guess)
            solution = near.advance(solution, load, tolerance=tolerance, budget=budget - iterations)
            iterations += solution.iterations
            missing = lacks * _size(solution.displacement - guess)
            if iterations >= budget or missing <= _SHARE_OF_ERROR * tolerance * _size(solution.displacement):
                break
        change = solution.displacement - last
        history = _core.active.followed(state.history, last, change, forgotten, taken_up, NIL_MM)
        return RelaxingState(replace(solution, iterations=iterations), forces, history)

    def _nearest(self, ramp: Array) -> tuple[ElasticSolver, Array, float]:
        """The solver of a step like that of such a ramp, 1 - r' of it, and the part of a change that it leaves."""
        best, left = 0.0, self._left(ramp, 0.0)
        if left > _NEAR:
            left, best = min((self._left(ramp, time), time) for time in (0.0, *self.times_s))
        if best not in self._solvers:
            self._solvers[best] = self.effective(best)
        return self._solvers[best], 1 - self._ramp(best), left

    def _left(self, ramp: Array, dt: float) -> float:
        """The part of a change that the operator of a step leaves in another, in the tissue where it is largest."""
        taken = self._ramp(dt)
        return float((self._fractions @ np.abs(taken - ramp) / (1 - self._fractions @ (1 - taken))).max())

    def _load(
        self, forces: Single, history: Single, parts: tuple[Array, Array, Array], last: Single, guess: Single
    ) -> Single:
        """The forces, and those of fields made of so many parts of the history, the last displacement and the guess."""
        amounts, operators = self._branches
        of_history, of_last, of_guess = (np.asarray(amounts * part, np.float32) for part in parts)
        fields = combined(of_history, history)
        load = forces.copy()
        for field, from_last, from_guess in zip(fields, of_last.sum(axis=1), of_guess.sum(axis=1), strict=True):
            field += (from_last + from_guess) * last
            if guess is not last:
                field += from_guess * (guess - last)
        if forces.any() or np.abs(fields).max(initial=0) > NIL_MM:
            for field, operator in zip(fields, operators, strict=True):
                if field.any():
                    load += operator.product(field)
        return load

    def _ramp(self, dt: float) -> Array:
        return ExponentialStep.of(self.times_s, dt).ramp

    def _stiffness(self, ramp: Array) -> Array:
        """What is left of the moduli of each cell for a change within a step."""
        return np.asarray(1 - np.tensordot(self._fractions @ (1 - ramp), self._shares, 1))

    @cached_property
    def _branches(self) -> tuple[Array, list[Any]]:
        """By how much some operators (n, terms) act on each field: one for each series, or for each term if fewer."""
        fractions, shares = self._fractions, self._shares
        if len(fractions) > len(self.times_s):
            fractions, shares = np.eye(len(self.times_s)), np.tensordot(fractions.T, shares, 1)
        return fractions, [self._product(share) for share in shares]

    def _product(self, share: Array) -> Any:
        """The operator of so large a share of the moduli of each cell, to multiply with."""
        moduli, solver = self.solver.moduli, self.solver
        share = np.maximum(share, _LEAST).astype(np.float32)
        spacing, lame, shear = hierarchy.finest(moduli)
        excess = moduli.layers.excess * share[tuple(moduli.layers.cells.T)][:, None, None]
        levels = [(spacing, lame * share, shear * share)]
        layers = {"layered": moduli.layers.cells, "excess": excess.astype(np.float32)}
        springs = moduli.springs_of(lame * share, shear * share)
        return _core.active.ElasticMultigrid(
            levels,
            solver.pinned,
            solver.integration == "full",
            1,
            np.zeros((0, 0), np.float32),
            **layers,
            springs=springs.astype(np.float32),
        )

    def __getstate__(self) -> dict[str, Any]:
        kept = {name: value for name, value in self.__dict__.items() if name != "_branches"}
        return {**kept, "_solvers": {0.0: self.solver}}

    def __repr__(self) -> str:
        return f"TissueRelaxation({len(self._fractions)} tissues, {len(self.times_s)} terms)"


def _size(values: Single) -> float:
    return float(np.abs(values).sum(dtype=np.float64))

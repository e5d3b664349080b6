"""Where elastic tissue is between two steps, as its solver knows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._by_bits import ByBits

Single = NDArray[np.float32]

TOLERANCE = 0.0125
"""Error estimate at which a step ends, by default."""
BUDGET = 12
"""Iterations of a step, at most, by default."""
NIL_MM, NIL_MN = 1e-9, 1e-11
"""So little of a displacement or a force is nothing. Left to halve and halve, numbers become slow to compute with, and
their squares vanish."""
FASTEST, SLOWEST = 0.15, 0.9
"""Contraction that an iteration is expected to be no better than: seen, it varies from 0.08 to 0.55. It is no worse but
where nothing is left to contract, and rounding decides."""
_FORESEEN = 100
"""Iterations, at most, that are looked ahead."""

BROKEN = (
    "the step did not converge (its energy is not positive); the last field is kept. "
    "Check the load and the stiffnesses for values far out of proportion"
)
"""What is said of a solver that no longer brings a field nearer."""


class NotConvergedError(RuntimeError):
    """A step did not converge; the state it started from is still in force."""


@dataclass(frozen=True, eq=False, repr=False)
class ElasticState(ByBits):
    """Where the tissue is between two steps. Made by :class:`ElasticSolver`, never changed.

    A step returns a new one, so that a step that fails leaves the old one as it was.
    """

    displacement: Single
    """(3, nx, ny, nz) on the solver's grid, along its axes."""
    load: Single
    """(3, nx, ny, nz) nodal forces it answers to."""
    error: float = 0.0
    """Estimated error of the displacement, relative to itself."""
    measured: bool = True
    """Whether the error was measured on this displacement, or follows from the one an iteration before."""
    iterations: int = 0
    """Iterations the last step took."""
    steps: int = 0
    """Steps since the needle was out."""
    contraction: float = 1.0
    """Error after over error before an iteration, where it was last measured."""
    before: float = 0.0
    """Estimate of the error before the last step's first iteration."""

    def nearer_than_none(self, forces: Single) -> bool:
        """Return whether the displacement is nearer, in energy, to that under other forces than none would be."""
        return bool(2 * np.vdot(forces, self.displacement) >= np.vdot(self.load, self.displacement))

    def left_after(self, iterations: int) -> float:
        """Return the part of an error that so many more iterations should leave."""
        return min(max(self.contraction, FASTEST), SLOWEST) ** min(iterations, _FORESEEN)

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.displacement.shape[1:]))
        return f"ElasticState({shape} nodes, {self.steps} steps, error={self.error:.2g})"


@dataclass(frozen=True, eq=False, repr=False)
class RelaxingState(ByBits):
    """Where relaxing tissue is between two steps. Made by :class:`RelaxingSolver`, never changed."""

    solution: ElasticState
    """The present displacement; its load is what elastic tissue would have to feel to be there."""
    forces: Single
    """(3, nx, ny, nz) nodal forces that act."""
    history: Single
    """(terms, 3, nx, ny, nz) what is left of the past, a field for each time constant: how far the filtered forces lag
    behind :attr:`forces` where all tissue relaxes alike, the filtered displacement where it does not."""

    def __post_init__(self) -> None:
        self.history.setflags(write=False)

    def __repr__(self) -> str:
        return f"RelaxingState({self.solution!r}, {len(self.history)} terms)"

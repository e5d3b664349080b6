"""Where elastic tissue is between two steps, as its solver knows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..._by_bits import ByBits

Single = NDArray[np.float32]

TOLERANCE = 0.05
"""Error estimate at which a step ends, by default."""
BUDGET = 12
"""Iterations of a step, at most, by default."""
ABLE = frozenset({"forces", "labels", "several needles"})
"""What the elastic model can do, in the words of the contract."""


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

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.displacement.shape[1:]))
        return f"ElasticState({shape} nodes, {self.steps} steps, error={self.error:.2g})"

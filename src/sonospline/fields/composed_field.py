"""Fields applied one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from ..geometry.grid import Grid
from .field import Field
from .maps import METHODS, Method

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ComposedField(Field):
    """Fields applied one after the other, each to the tissue the last one left (Algorithm 1, line 10)."""

    steps: tuple[Field, ...]
    grid: Grid
    nodes: Array
    """(N, 3) present positions of the grid's nodes."""

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3) of the undeformed body; (3,) at one point."""
        x, shape = _validate.rows("points", points)
        moved = x
        for step in self.steps:
            moved = step.forward(moved)
        return (moved - x).reshape(*shape, 3)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, the product of the steps'; (3, 3) at one point."""
        moved, shape = _validate.rows("points", points)
        total = np.broadcast_to(np.eye(3), (len(moved), 3, 3))
        for step in self.steps:
            total = step.jacobian(moved) @ total
            moved = step.forward(moved)
        return total.reshape(*shape, 3, 3)

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3); already known, in float64."""
        _validate.choice("method", method, METHODS)
        return (self.nodes - self.grid.points).reshape(*self.grid.shape, 3)

    def _facts(self) -> list[str]:
        return [*super()._facts(), f"{len(self.steps)} steps"]

    @property
    def length(self) -> float:
        """Side of the grid."""
        return self.grid.side

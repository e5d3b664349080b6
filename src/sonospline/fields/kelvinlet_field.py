"""A field that is a sum of Kelvinlets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from ..geometry.grid import Grid
from .field import Field
from .kelvinlet import Kelvinlet
from .maps import Method

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class KelvinletField(Field):
    """A sum of Kelvinlets, ``u(x) = sum_j K(x - c_j) f_j``."""

    kernel: Kelvinlet
    centres: Array
    forces: Array
    grid: Grid

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3); (3,) at one point."""
        x, shape = _validate.rows("points", points)
        return self.kernel.sum(x, self.centres, self.forces).reshape(*shape, 3)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, analytic; (3, 3) at one point."""
        x, shape = _validate.rows("points", points)
        return (np.eye(3) + self.kernel.gradient(x, self.centres, self.forces)).reshape(*shape, 3, 3)

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3)."""
        return self.displacement(self.grid.points).reshape(*self.grid.shape, 3)

    def _facts(self) -> list[str]:
        return [*super()._facts(), f"{len(self.centres)} centres"]

    @property
    def length(self) -> float:
        """Side of the grid."""
        return self.grid.side

"""The maps of a field known at the nodes of a grid: cheap at very many points, as images need it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core, _memory, _validate
from .._core import cubic_axis
from .._shown import size
from ..geometry.grid import Grid
from .maps import FieldMaps, InverseReport, Method

Array = NDArray[np.float64]

_FEWEST_NODES = 4
"""Along an axis, for a cubic between nodes to be resampled axis by axis."""
_FEW = 4
"""Points that cost less one by one than the coefficients of the whole lattice."""


@dataclass(frozen=True, eq=False, repr=False)
class SampledMaps(FieldMaps):
    """Values at nodes, linear or cubic between them; see :class:`~sonospline.GridField`."""

    grid: Grid
    values: NDArray[np.floating]
    lattice: Grid | None = None
    order: int = 1
    error_estimate: float | None = None
    inverse_tolerance = 1e-6
    """Values are kept in float32 for sampling."""

    def __post_init__(self) -> None:
        if self.lattice is None:
            object.__setattr__(self, "lattice", self.grid)
        if self.order not in (1, 3):
            raise ValueError(f"order = {self.order!r} is not known; give 1 (linear) or 3 (cubic)")
        expected = (*self._nodes.shape, 3)
        if self.values.shape != expected:
            raise ValueError(f"values has shape {self.values.shape}; give {expected}, as the lattice")

    @classmethod
    def of(cls, field: FieldMaps, method: Method = "auto", *, order: int = 1) -> Self:
        """Return a field sampled at the nodes of its own grid."""
        if field.grid is None:
            raise ValueError("field.grid = None: fit the field with grid= to sample it")
        return cls(field.grid, field.on_grid(method), order=order, error_estimate=field.error_estimate)

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3); (3,) at one point."""
        x, shape = _validate.rows("points", points)
        local = self._nodes.local(x)
        few = self.order == 3 and 0 < len(local) <= _FEW and "_sampled" not in self.__dict__
        along = self._one_by_one(local) if few else self._at(local)
        return (along @ self._nodes.direction.T).reshape(*shape, 3)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map; (3, 3) at one point.

        Of a cubic field it is exact; of a linear one it is taken from differences over one
        spacing.
        """
        x, shape = _validate.rows("points", points)
        local, axes = self._nodes.local(x), self._nodes.direction
        if self.order == 3:
            slopes = _core.active.gradient_lattice(self._sampled, self._nodes.spacing, local)
            return (np.eye(3) + axes @ slopes @ axes.T).reshape(*shape, 3, 3)
        steps = np.diag(self._nodes.spacing)
        differences = [(self._at(local + h / 2) - self._at(local - h / 2)) / h.sum() for h in steps]
        return (np.eye(3) + axes @ np.stack(differences, axis=-1) @ axes.T).reshape(*shape, 3, 3)

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3); the values themselves where they are there."""
        nodes, grid = self._nodes, self.grid
        if nodes is grid:
            return self.values
        _memory.refuse_beyond(28 * grid.node_count, f"grid = {grid.shape}: its displacements")
        aligned = (nodes.direction == grid.direction).all()
        if self.order == 1 or not aligned or min(nodes.shape) < _FEWEST_NODES:
            return self.displacement(grid.points).reshape(*grid.shape, 3).astype(np.float32)
        start = nodes.local(grid.origin[None])[0]
        x, y, z = (
            cubic_axis.resampling(n, h, float(s), m, step)
            for n, h, s, m, step in zip(nodes.shape, nodes.spacing, start, grid.shape, grid.spacing, strict=True)
        )
        planes = np.ascontiguousarray(self.values.transpose(3, 0, 1, 2), np.float32)
        return _core.active.resample_lattice(planes, x[0], y[0], z[1])

    def interpolation_error(self, exact: FieldMaps, *, points: int = 20_000, seed: int = 0) -> tuple[float, float]:
        """Return the largest and the root-mean-square difference from another field at random points of the box."""
        where = self._nodes.world(np.random.default_rng(seed).random((points, 3)) * self._nodes.extent)
        error = np.linalg.norm(self.displacement(where) - exact.displacement(where), axis=1)
        return float(error.max()), float(np.sqrt((error**2).mean()))

    def _facts(self) -> list[str]:
        between = {1: "linear", 3: "cubic"}[self.order]
        values = "" if self._nodes is self.grid else f" from {size(self._nodes.shape)} nodes"
        return [*super()._facts(), between + values]

    @property
    def length(self) -> float:
        """Side of the lattice."""
        return self._nodes.side

    @property
    def _nodes(self) -> Grid:
        return self.grid if self.lattice is None else self.lattice

    @cached_property
    def along_axes(self) -> NDArray[np.float32]:
        """The values along the lattice axes, as the core takes them."""
        along = self.values if self._nodes.upright else self.values @ self._nodes.direction
        return np.ascontiguousarray(along, dtype=np.float32)

    @cached_property
    def _sampled(self) -> NDArray[np.float32]:
        """What the core samples: the values along the lattice axes, or the coefficients of their spline."""
        return self.along_axes if self.order == 1 else cubic_axis.coefficients(self.along_axes)

    def _one_by_one(self, local: Array) -> Array:
        """Displacement at a few points by their own sums over all nodes: no coefficients are made."""
        found = []
        for place in local / self._nodes.spacing:
            value: NDArray[np.floating] = self.along_axes
            for n, x in zip(self._nodes.shape, place, strict=True):
                weights = cubic_axis.weights(n, x).astype(np.float32)
                value = np.einsum("i,im->m", weights, value.reshape(n, -1))
            found.append(value)
        return np.stack(found)

    def _at(self, local: Array) -> Array:
        """Displacement along the lattice axes at points in its frame."""
        return _core.active.sample_lattice(self._sampled, self._nodes.spacing, local, self.order)

    def _find_inverse(self, target: Array, tolerance: float, max_iterations: int) -> tuple[Array, InverseReport]:
        local, iterations = _core.active.invert_lattice(
            self._sampled, self._nodes.spacing, self._nodes.local(target), tolerance, max_iterations, self.order
        )
        x = self._nodes.world(local)
        converged = iterations > 0
        x[~converged] = np.nan
        missing = target[converged] - self.forward(x[converged])
        residual = float(np.linalg.norm(missing, axis=1).max(initial=0.0))
        return x, InverseReport(converged, int(iterations.max(initial=0)), residual)

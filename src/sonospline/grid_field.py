"""A field known at the nodes of a grid: cheap at very many points, as images need it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core, _validate
from .field import Field, InverseReport, Method
from .grid import Grid

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GridField(Field):
    """A field of values at nodes, linear between them.

    A point costs the same however many landmarks made the field. Against the kernel sum it
    errs by the curvature between nodes, and most next to a landmark, where U = r has its
    kink: :meth:`interpolation_error` measures it.

    Parameters
    ----------
    grid : Grid
        The nodes. Beyond the grid the field keeps the value of the nearest point of its box.
    values : (nx, ny, nz, 3) ndarray
        Displacement at the nodes, in world coordinates.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> field = insertion.advance(ss.Needle((0, .5, .5), (.5, .5, .5)))
    >>> sampled = ss.GridField.of(field)
    >>> p = np.random.default_rng(0).random((1000, 3))
    >>> bool(abs(sampled.displacement(p) - field.displacement(p)).max() < 1e-3)
    True
    """

    grid: Grid
    values: NDArray[np.floating]
    inverse_tolerance = 1e-6
    """Values are kept in float32 for sampling."""

    def __post_init__(self) -> None:
        if self.values.shape != (*self.grid.shape, 3):
            raise ValueError(f"values has shape {self.values.shape}; give {(*self.grid.shape, 3)}, as the grid")

    @classmethod
    def of(cls, field: Field, method: Method = "auto") -> GridField:
        """Return a field sampled at the nodes of its own grid."""
        if field.grid is None:
            raise ValueError("field.grid = None: fit the field with grid= to sample it")
        return cls(field.grid, field.on_grid(method))

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3), linear between nodes."""
        local = self.grid.local(_validate.points("points", points))
        return _core.active.sample_lattice(self.along_axes, self.grid.spacing, local) @ self.grid.direction.T

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, from differences over one spacing."""
        points = _validate.points("points", points)
        slopes = []
        for axis, spacing in enumerate(self.grid.spacing):
            half = 0.5 * spacing * self.grid.direction[:, axis]
            slopes.append((self.displacement(points + half) - self.displacement(points - half)) / spacing)
        return np.eye(3) + np.stack(slopes, axis=-1) @ self.grid.direction.T

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3): the values themselves."""
        return self.values

    def interpolation_error(self, exact: Field, *, points: int = 20_000, seed: int = 0) -> tuple[float, float]:
        """Return the largest and the root-mean-square difference from another field at random points of the box."""
        where = self.grid.world(np.random.default_rng(seed).random((points, 3)) * self.grid.extent)
        error = np.linalg.norm(self.displacement(where) - exact.displacement(where), axis=1)
        return float(error.max()), float(np.sqrt((error**2).mean()))

    @property
    def length(self) -> float:
        """Side of the grid."""
        return self.grid.side

    @cached_property
    def along_axes(self) -> NDArray[np.float32]:
        """The values along the lattice axes, as the core takes them."""
        return np.ascontiguousarray(self.values @ self.grid.direction, dtype=np.float32)

    def _find_inverse(self, target: Array, tolerance: float, max_iterations: int) -> tuple[Array, InverseReport]:
        local, iterations = _core.active.invert_lattice(
            self.along_axes, self.grid.spacing, self.grid.local(target), tolerance, max_iterations
        )
        x = self.grid.world(local)
        converged = iterations > 0
        x[~converged] = np.nan
        missing = target[converged] - self.forward(x[converged])
        residual = float(np.linalg.norm(missing, axis=1).max(initial=0.0))
        return x, InverseReport(converged, int(iterations.max(initial=0)), residual)

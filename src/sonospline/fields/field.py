"""The deformation field: what images, forces and files see, whoever made it."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _memory, _validate
from ..geometry.grid import Grid
from . import lattice_sum
from .kernel import Kernel

Array = NDArray[np.float64]
Method = Literal["auto", "multilevel", "accurate", "direct32", "direct"]
METHODS = ("auto", "multilevel", "accurate", "direct32", "direct")
_BYTES = {"auto": 16, "multilevel": 16, "accurate": 16, "direct32": 16, "direct": 28}
"""Memory of each way to evaluate, per node: the result and scratch."""

logger = logging.getLogger(__name__)


class InverseReport(NamedTuple):
    """How an inverse map was found."""

    converged: NDArray[np.bool_]
    """(m,) points whose inverse is known; the others are NaN."""
    iterations: int
    """Fixed-point iterations made."""
    residual: float
    """Largest ``|forward(inverse(p)) - p|`` over the converged points."""


class Field(ABC):
    """A displacement field u(x) of tissue, in world coordinates of the undeformed body.

    ``forward`` maps undeformed to deformed positions, x + u(x); ``inverse`` maps back.
    """

    grid: Grid | None
    """The lattice of :meth:`on_grid`."""
    inverse_tolerance = 1e-9
    """Default tolerance of :meth:`inverse`, in units of the field's length."""
    error_estimate: float | None = None
    """Error relative to the field itself, where its maker knows it: an unfinished elastic solution does."""

    @abstractmethod
    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3)."""

    @abstractmethod
    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, I + du_a/dx_b, at points (m, 3)."""

    @abstractmethod
    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3).

        Parameters
        ----------
        method : str, default: "auto"
            ``"auto"`` takes the cheapest way that errs by at most 1e-5 of the side.
            ``"multilevel"`` needs U = r and landmarks on nodes; its cost hardly depends on
            their number. ``"accurate"`` is the same to 1e-6. Where they do not apply, the
            direct sum takes their place. ``"direct32"`` sums in float32: 3e-7 for U = r,
            1e-5 for r^3, whose terms cancel. ``"direct"`` sums in float64, the reference.
        """

    def forward(self, points: ArrayLike) -> Array:
        """Return the deformed positions x + u(x) (m, 3) of world points (m, 3), eq. (8)."""
        points = _validate.points("points", points)
        return points + self.displacement(points)

    @overload
    def inverse(self, points: ArrayLike, *, tolerance: float | None = ..., max_iterations: int = ...) -> Array: ...
    @overload
    def inverse(
        self,
        points: ArrayLike,
        *,
        tolerance: float | None = ...,
        max_iterations: int = ...,
        return_report: Literal[True],
    ) -> tuple[Array, InverseReport]: ...

    def inverse(
        self,
        points: ArrayLike,
        *,
        tolerance: float | None = None,
        max_iterations: int = 100,
        return_report: bool = False,
    ) -> Array | tuple[Array, InverseReport]:
        """Return the undeformed positions x with x + u(x) = p, for world points p (m, 3).

        Fixed-point iteration x <- p - u(x), which contracts while ``|grad u| < 1``. A point
        that does not converge is NaN, never a guess, and is counted in the log.

        Parameters
        ----------
        points : (m, 3) array_like
            Deformed positions.
        tolerance : float, optional
            Largest ``|x + u(x) - p|`` accepted; by default ``inverse_tolerance`` of the field's length.
        max_iterations : int, default: 100
            Iterations before a point is given up.
        return_report : bool, default: False
            Also return an :class:`InverseReport`.

        Examples
        --------
        >>> import numpy as np, sonospline as ss
        >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(13)))
        >>> field = insertion.advance(ss.Needle((0, .5, .5), (.5, .5, .5)))
        >>> p = np.array([[.4, .45, .5]])
        >>> bool(np.allclose(field.inverse(field.forward(p)), p, atol=1e-8))
        True
        """
        target = _validate.points("points", points)
        _validate.count("max_iterations", max_iterations)
        default = self.inverse_tolerance * self.length
        limit = default if tolerance is None else _validate.number("tolerance", tolerance, positive=True)
        x, report = self._find_inverse(target, limit, max_iterations)
        if not report.converged.all():
            logger.warning("inverse map: %d of %d points did not converge", (~report.converged).sum(), len(x))
        return (x, report) if return_report else x

    def _find_inverse(self, target: Array, tolerance: float, max_iterations: int) -> tuple[Array, InverseReport]:
        x, remaining = target.copy(), np.arange(len(target))
        residual, iterations = 0.0, 0
        while len(remaining) and iterations < max_iterations:
            iterations += 1
            missing = target[remaining] - self.forward(x[remaining])
            size = np.linalg.norm(missing, axis=1)
            done = size <= tolerance
            residual = max(residual, float(size[done].max(initial=0.0)))
            x[remaining[~done]] += missing[~done]
            # A point sent far outside is lost; stop before it overflows.
            lost = ~done & (size > 10 * self.length)
            x[remaining[lost]] = np.nan
            remaining = remaining[~done & ~lost]
        x[remaining] = np.nan
        return x, InverseReport(np.logical_and.reduce(np.isfinite(x), axis=1), iterations, residual)

    def smallest_jacobian(self) -> float:
        """Return the smallest det J over the grid's nodes; at or below zero the tissue folds over."""
        return float(np.linalg.det(self.jacobian(self._require_grid().points)).min())

    @property
    @abstractmethod
    def length(self) -> float:
        """The length that errors of this field are measured in: the side of its box."""

    def _require_grid(self) -> Grid:
        if self.grid is None:
            raise ValueError("grid = None: this field knows no grid; pass grid= where it is fitted")
        return self.grid


@dataclass(frozen=True, eq=False, kw_only=True)
class KernelField(Field):
    """A field that is a kernel sum, ``u(x) = a0 + A (x - reference) + sum_j w_j U(|x - c_j|)``, eq. (1).

    Parameters
    ----------
    kernel : Kernel
        U.
    centres : (n, 3) ndarray
        Landmarks c_j in world coordinates.
    weights : (n, 3) ndarray
        Their weights w_j.
    affine : (4, 3) ndarray
        a0, then the rows that multiply x, y, z.
    reference : (3,) ndarray
        Where the affine part is a0: the middle of the landmarks.
    grid : Grid, optional
        The lattice of :meth:`on_grid`.
    nodes : (n, 3) ndarray, optional
        Lattice index of each landmark, where all lie on nodes of the grid; found where not given.
    """

    kernel: Kernel
    centres: Array
    weights: Array
    affine: Array
    reference: Array
    grid: Grid | None = None
    nodes: NDArray[np.int64] | None = None

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3), in float64."""
        points = _validate.points("points", points)
        centres, weights, affine = self._scaled(self.centres - self.reference)
        local = (points - self.reference) / self.length
        return self.kernel.sum(local, centres, weights, affine, single=False)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, analytic.

        U = r has a kink at its own centre, where its gradient counts as zero: the mean of
        its values around.
        """
        points = _validate.points("points", points)
        centres, weights, affine = self._scaled(self.centres - self.reference)
        local = (points - self.reference) / self.length
        return np.eye(3) + self.kernel.gradient(local, centres, weights, affine) / self.length

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3)."""
        _validate.choice("method", method, METHODS)
        grid = self._require_grid()
        _memory.refuse_beyond(_BYTES[method] * grid.node_count, f"grid = {grid.shape}: its displacements")
        _, weights, affine = self._scaled(self.centres)
        # The same affine map, seen from node 0 along the lattice axes.
        at_node_0 = (grid.origin - self.reference) @ self.affine[1:] + self.affine[0]
        affine = np.vstack([at_node_0, grid.direction.T @ affine[1:]])
        spacing = tuple(h / self.length for h in grid.spacing)
        if method not in ("direct", "direct32"):
            fast = self._multilevel(method, spacing)
            if fast is not None:
                return fast.plan.evaluate(fast.nodes, weights, affine, fast.depth)
        single = method == "direct32" or (method != "direct" and self.kernel.single_precision)
        centres = grid.local(self.centres) / self.length
        return self.kernel.sum_on_lattice(grid.shape, spacing, centres, weights, affine, single=single)  # type: ignore[arg-type]

    def _multilevel(self, method: str, spacing: tuple[float, ...]) -> lattice_sum.LatticeSum | None:
        """The multilevel sum where it applies and, for ``"auto"``, where it costs less."""
        if not self.kernel.multilevel:
            return None
        grid = self._require_grid()
        nodes = self.nodes
        if nodes is None:
            nodes = lattice_sum.node_index(grid.local(self.centres), grid.shape, grid.spacing)
        if nodes is None:
            return None
        promise = lattice_sum.PROMISES["accurate" if method == "accurate" else "multilevel"]
        fast = lattice_sum.choose(grid.shape, spacing, nodes, self.weights, promise)
        return None if fast is None or (method == "auto" and fast.depth == 0) else fast

    @cached_property
    def length(self) -> float:
        """Side of the grid, or of the landmarks' box where there is no grid."""
        if self.grid is not None:
            return self.grid.side
        return float(np.ptp(self.centres, axis=0).max())

    def _scaled(self, centres: Array) -> tuple[Array, Array, Array]:
        """Centres, weights and affine part for coordinates in units of ``length``.

        Metres, millimetres or micrometres then give the same figures, in float32 too.
        """
        weights = self.weights * self.length**self.kernel.homogeneity
        affine = self.affine * np.array([1.0, *[self.length] * 3])[:, None]
        return centres / self.length, weights, affine


@dataclass(frozen=True, eq=False)
class ComposedField(Field):
    """Fields applied one after the other, each to the tissue the last one left (Algorithm 1, line 10)."""

    steps: tuple[Field, ...]
    grid: Grid
    nodes: Array
    """(N, 3) present positions of the grid's nodes."""

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3) of the undeformed body."""
        points = _validate.points("points", points)
        moved = points
        for step in self.steps:
            moved = step.forward(moved)
        return moved - points

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map: the product of the steps'."""
        moved = _validate.points("points", points)
        total = np.broadcast_to(np.eye(3), (len(moved), 3, 3))
        for step in self.steps:
            total = step.jacobian(moved) @ total
            moved = step.forward(moved)
        return total

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3); already known, in float64."""
        _validate.choice("method", method, METHODS)
        return (self.nodes - self.grid.points).reshape(*self.grid.shape, 3)

    @property
    def length(self) -> float:
        """Side of the grid."""
        return self.grid.side

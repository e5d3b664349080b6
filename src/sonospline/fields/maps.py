"""The maps of a deformation: where points go, where they came from, and how tissue is strained there."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from typing import Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import lengths, size
from ..geometry.grid import Grid

Array = NDArray[np.float64]
Method = Literal["auto", "multilevel", "accurate", "direct32", "direct"]
METHODS = ("auto", "multilevel", "accurate", "direct32", "direct")

logger = logging.getLogger(__name__)


class InverseReport(NamedTuple):
    """How an inverse map was found."""

    converged: NDArray[np.bool_]
    """(m,) points whose inverse is known; the others are NaN."""
    iterations: int
    """Fixed-point iterations made."""
    residual: float
    """Largest ``|forward(inverse(p)) - p|`` over the converged points."""

    def __repr__(self) -> str:
        return (
            f"InverseReport({np.sum(self.converged)} of {np.size(self.converged)} points, {self.iterations} iterations)"
        )


class FieldMaps(ABC):
    """What a displacement field u(x) of tissue answers, in world coordinates of the undeformed body.

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
        """Return u (m, 3) at world points (m, 3); (3,) at one point (3,), and alike in every map."""

    @abstractmethod
    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, I + du_a/dx_b, at points (m, 3); (3, 3) at one."""

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
        """Return the deformed positions x + u(x) (m, 3) of world points (m, 3), eq. (8); (3,) of one."""
        x, shape = _validate.rows("points", points)
        return (x + self.displacement(x)).reshape(*shape, 3)

    @overload
    def inverse(
        self,
        points: ArrayLike,
        *,
        tolerance: float | None = ...,
        max_iterations: int = ...,
        return_report: Literal[False] = ...,
    ) -> Array: ...
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
        """Return the undeformed positions x (m, 3) with x + u(x) = p, for world points p (m, 3); (3,) for one.

        Fixed-point iteration x <- p - u(x), which contracts while ``|grad u| < 1``. A point
        that does not converge is NaN, never a guess, and is counted in the log.

        Parameters
        ----------
        points : (m, 3) or (3,) array_like
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
        >>> p = (.4, .45, .5)
        >>> bool(np.allclose(field.inverse(field.forward(p)), p, atol=1e-8))
        True
        """
        target, shape = _validate.rows("points", points)
        _validate.count("max_iterations", max_iterations)
        default = self.inverse_tolerance * self.length
        limit = default if tolerance is None else _validate.number("tolerance", tolerance, positive=True)
        x, report = self._find_inverse(target, limit, max_iterations)
        if not report.converged.all():
            logger.warning("inverse map: %d of %d points did not converge", (~report.converged).sum(), len(x))
        x = x.reshape(*shape, 3)
        return (x, report._replace(converged=report.converged.reshape(shape))) if return_report else x

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

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self._facts())})"

    def _facts(self) -> list[str]:
        """What its text says."""
        return ["no grid"] if self.grid is None else [size(self.grid.shape), lengths(self.grid.spacing)]

    def det_jacobian(self) -> Array:
        """Return det J at every node of the grid, as (nx, ny, nz); at or below zero the tissue folds over."""
        grid = self.require_grid()
        return np.linalg.det(self.jacobian(grid.points)).reshape(grid.shape)

    def smallest_jacobian(self) -> float:
        """Return the smallest det J over the grid's nodes; at or below zero the tissue folds over."""
        return float(self.det_jacobian().min())

    @property
    @abstractmethod
    def length(self) -> float:
        """The length that errors of this field are measured in: the side of its box."""

    def require_grid(self) -> Grid:
        """Return the grid; ValueError where the field knows none."""
        if self.grid is None:
            raise ValueError("grid = None: this field knows no grid; pass grid= where it is fitted")
        return self.grid

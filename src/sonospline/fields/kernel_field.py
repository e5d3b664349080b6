"""A field that is a sum of kernels: what a spline leaves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _memory, _validate
from ..geometry.grid import Grid
from . import lattice_sum
from .field import Field
from .kernel import Kernel
from .maps import METHODS, Method

Array = NDArray[np.float64]
_BYTES = {"auto": 16, "multilevel": 16, "accurate": 16, "direct32": 16, "direct": 28}
"""Memory of each way to evaluate, per node: the result and scratch."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
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
        """Return u (m, 3) at world points (m, 3), in float64; (3,) at one point."""
        x, shape = _validate.rows("points", points)
        centres, weights, affine = self._scaled(self.centres - self.reference)
        local = (x - self.reference) / self.length
        return self.kernel.sum(local, centres, weights, affine, single=False).reshape(*shape, 3)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, analytic; (3, 3) at one point.

        U = r has a kink at its own centre, where its gradient counts as zero: the mean of
        its values around.
        """
        x, shape = _validate.rows("points", points)
        centres, weights, affine = self._scaled(self.centres - self.reference)
        local = (x - self.reference) / self.length
        slopes = self.kernel.gradient(local, centres, weights, affine) / self.length
        return (np.eye(3) + slopes).reshape(*shape, 3, 3)

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3)."""
        _validate.choice("method", method, METHODS)
        grid = self.require_grid()
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

    def _facts(self) -> list[str]:
        return [*super()._facts(), f"{len(self.centres)} centres"]

    def _multilevel(self, method: str, spacing: tuple[float, ...]) -> lattice_sum.LatticeSum | None:
        """The multilevel sum where it applies and, for ``"auto"``, where it costs less."""
        if not self.kernel.multilevel:
            return None
        grid = self.require_grid()
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

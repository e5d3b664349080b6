"""NumPy twin of the core's elastic solver: the same iteration on assembled sparse matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..hexahedra import Level, assembled, free_nodes, layer_stiffness, stiffness
from ..stencils import Lattice, from_sparse, nested, to_sparse
from .checks import numbered, require, require_spacing

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Mask = NDArray[np.uint8]

_COARSEST_STEPS, _HIGHEST_DEGREE = 30, 100
_POWER_ITERATIONS = 15
_MARGIN, _RANGE = 1.1, 20.0


def axis_transfer(fine: int, coarse: int, nested: bool = False) -> Array:
    """Return the linear interpolation (fine + 1, coarse + 1) between two divisions of an axis into cells.

    Coarse nodes are evenly spaced or, where they are ``nested``, every second fine one and the last.
    """
    at = np.arange(fine + 1) * (coarse / fine)
    if nested and coarse < fine:
        at = np.append(np.arange(fine) / 2, coarse)
    first = np.minimum((at + 1e-9).astype(int), coarse - 1)
    second = np.maximum(at - first, 0.0)
    out = np.zeros((fine + 1, coarse + 1))
    out[np.arange(fine + 1), first] = 1 - second
    out[np.arange(fine + 1), first + 1] += second
    return out


class _Grid:
    """One level: its operator on the free nodes, and its smoothing."""

    def __init__(self, matrix: Any, shape: tuple[int, ...], free: NDArray[np.bool_], degree: int) -> None:
        self.shape = shape
        self.all = matrix
        self.free = np.tile(free.ravel(), 3)
        self.matrix = self.all[self.free][:, self.free]
        self.inverse_diagonal = 1 / self.matrix.diagonal()
        self.steps = _chebyshev(self._largest_eigenvalue(), degree)

    def smooth(self, right: Array, start: Array | None) -> Array:
        """Chebyshev steps for matrix x = right."""
        x = np.zeros_like(right) if start is None else start
        d = np.zeros_like(right)
        for momentum, step in self.steps:
            d = momentum * d + step * self.inverse_diagonal * (right - self.matrix @ x)
            x = x + d
        return x

    def _largest_eigenvalue(self) -> float:
        seed, x = np.uint64(12345), np.empty(len(self.free))
        for i in range(len(x)):
            seed = (seed * np.uint64(1664525) + np.uint64(1013904223)) & np.uint64(0xFFFFFFFF)
            x[i] = float(seed >> np.uint64(16)) / 65536 - 0.5
        x = x[self.free]
        largest = 1.0
        for _ in range(_POWER_ITERATIONS):
            ahead = self.matrix @ x
            largest = float(np.sqrt(self.inverse_diagonal @ ahead**2))
            x = self.inverse_diagonal * ahead / largest
        return largest


def _chebyshev(largest: float, degree: int) -> list[tuple[float, float]]:
    high, low = _MARGIN * largest, largest / _RANGE
    middle, half = (high + low) / 2, (high - low) / 2
    rho = half / middle
    steps = [(0.0, 1 / middle)]
    for _ in range(degree - 1):
        following = 1 / (2 * middle / half - rho)
        steps.append((following * rho, 2 * following / half))
        rho = following
    return steps


class ElasticMultigrid:
    """Conjugate gradients preconditioned by a multigrid cycle, for elasticity on a lattice.

    Parameters
    ----------
    levels : list of (spacing, lame, shear)
        The finest level first: cell sides and both Lamé moduli (cx, cy, cz), float32.
    pinned : list of bool
        Which of the faces x-, x+, y-, y+, z-, z+ do not move.
    full : bool
        Integrate the dilatation fully instead of taking its mean over each cell.
    degree : int
        Chebyshev steps before and after each coarser level.
    coarse_inverse : (m, m) ndarray
        Inverse of the last level's operator over its free unknowns (component, node), or
        (0, 0): then that level is smoothed 30 times.
    fixed : (nx, ny, nz) ndarray of uint8, optional
        Nodes of the finest level, besides those of pinned faces, that do not move.
    stencils : sequence of (126, nx, ny, nz) ndarray
        Explicit operators of grids coarser still, see :mod:`sonospline._core.stencils`.
    layered : (n, 3) ndarray of int64, optional
        Index of cells of the finest level that resist more than their moduli say.
    excess : (n, 6, 6) ndarray, optional
        By so much, to their mean strain. It belongs to the operator, and not to the cycle.
    springs : (3, nx, ny, nz) ndarray of float32, optional
        That hold the nodes of the finest level along each axis, besides its cells; at or above zero.
    """

    def __init__(
        self,
        levels: list[Level],
        pinned: list[bool],
        full: bool,
        degree: int,
        coarse_inverse: Single,
        fixed: Mask | None = None,
        stencils: Sequence[Single] = (),
        layered: NDArray[np.int64] | None = None,
        excess: Single | None = None,
        springs: Single | None = None,
    ) -> None:
        for spacing, lame, shear in levels:
            require(lame.shape == shear.shape, "lame and shear differ in shape")
            require(numbered(lame.shape, 1), "lame has no cell along an axis, or too many")
            require_spacing(spacing)
        n = coarse_inverse.shape[0]
        require(coarse_inverse.shape == (n, n), "coarse_inverse is not square")
        require(len(levels) > 0, "levels is empty")
        require(1 <= degree <= _HIGHEST_DEGREE, "degree is not between 1 and 100")
        operators = [(stiffness(level, full), free_nodes(level[1].shape, pinned)) for level in levels]
        if fixed is not None:
            require(fixed.shape == operators[0][1].shape, "fixed is not over the nodes of the cells")
            operators[0][1][fixed != 0] = False
        if springs is not None:
            require(springs.shape == (3, *operators[0][1].shape), "springs are not over the nodes of the cells")
            from scipy.sparse import diags

            held = diags(springs.ravel().astype(float))
            operators[0] = operators[0][0] + held, operators[0][1]
        for stencil in stencils:
            _require_coarser(operators[-1][1].shape, stencil.shape[1:])
            operators.append((to_sparse(stencil), stencil[0] > 0))
        require(
            n in (0, 3 * operators[-1][1].sum()),
            "coarse_inverse is neither empty nor over the free unknowns of the last level",
        )
        last = len(operators) - 1
        self._grids = [
            _Grid(matrix, free.shape, free, _COARSEST_STEPS if i == last else degree)
            for i, (matrix, free) in enumerate(operators)
        ]
        finest = self._grids[0]
        self._all, self._matrix = finest.all, finest.matrix
        require((layered is None) == (excess is None), "layered and excess belong together")
        if layered is not None and excess is not None:
            require(len(layered) == len(excess), "layered and excess differ in length")
            cells = np.array(levels[0][1].shape)
            require(bool(((layered >= 0) & (layered < cells)).all()), "layered has a cell beyond the grid")
            self._all = finest.all + layer_stiffness(finest.shape, levels[0][0], layered, excess)
            self._matrix = self._all[finest.free][:, finest.free]
        self._coarse_inverse = coarse_inverse.astype(float)
        self._prolongations = [
            _prolongation(fine.shape, coarse.shape, nested=i + 1 >= len(levels))[fine.free][:, coarse.free]
            for i, (fine, coarse) in enumerate(zip(self._grids[:-1], self._grids[1:], strict=True))
        ]

    def iterate(self, load: Single, start: Single, iterations: int, estimate: bool) -> tuple[Single, list[float], bool]:
        """Improve a displacement (3, nx, ny, nz) for a nodal load of that shape.

        Returns the displacement; the mean of ``|V r|`` over that of ``|u|``, with the residual
        before each iteration and, with ``estimate``, after the last; and whether the operator
        proved positive throughout. The cycle V is nearly the inverse, so V r is what u lacked.
        """
        grid = self._grids[0]
        self._check(load)
        self._check(start)
        require(0 <= iterations <= 10_000, "iterations is not between 0 and 10000")
        b, u = load.reshape(-1)[grid.free].astype(float), start.reshape(-1)[grid.free].astype(float)
        r = b - self._matrix @ u
        errors, sound, direction, old = [], True, np.zeros_like(u), 1.0

        def note(missing: Array) -> None:
            lacking, found = (np.linalg.norm(v.reshape(3, -1), axis=0).sum() for v in (missing, u))
            errors.append(0.0 if lacking == 0 else float(lacking / found) if found > 0 else 1.0)

        for iteration in range(iterations):
            z = self._cycle(0, r)
            size = float(r @ z)
            direction = z + (size / old * direction if iteration else 0)
            ahead = self._matrix @ direction
            stiff = float(direction @ ahead)
            sound = sound and bool(np.isfinite(stiff)) and (stiff > 0 or size == 0)
            step = size / stiff if stiff > 0 else 0.0
            u = u + step * direction
            r = r - step * ahead
            old = size
            note(z)
        if estimate:
            note(self._cycle(0, r))
        out = np.zeros(len(grid.free), np.float32)
        out[grid.free] = u
        return out.reshape(3, *grid.shape), errors, sound and bool(np.isfinite(errors).all())

    def product(self, values: Single) -> Single:
        """Return the operator times (3, nx, ny, nz), reactions at the pinned nodes included."""
        self._check(values)
        return (self._all @ values.reshape(-1).astype(float)).astype(np.float32).reshape(values.shape)

    def _check(self, values: Single) -> None:
        require(values.shape == (3, *self._grids[0].shape), "values are not of the solver's shape")

    def _cycle(self, number: int, right: Array) -> Array:
        grid = self._grids[number]
        if number == len(self._grids) - 1:
            return self._coarse_inverse @ right if len(self._coarse_inverse) else grid.smooth(right, None)
        x = grid.smooth(right, None)
        prolongation = self._prolongations[number]
        x = x + prolongation @ self._cycle(number + 1, prolongation.T @ (right - grid.matrix @ x))
        return grid.smooth(right, x)


def galerkin_of_cells(
    lame: Single, shear: Single, dilatation: Array, distortion: Array, fixed: Mask, coarse: Lattice
) -> Single:
    """Return the operator of cells over coarse nodes: P^T A P, with P zero where nodes do not move.

    Parameters
    ----------
    lame, shear : (cx, cy, cz) ndarray
        Moduli.
    dilatation, distortion : (24, 24) ndarray
        Of a cell of unit moduli, see :func:`~sonospline._core.hexahedra.cell_matrices`.
    fixed : (nx, ny, nz) ndarray of uint8
        Nodes that do not move; a coarse node that is one of them has no blocks.
    coarse : tuple of int
        Coarse nodes along each axis: as many, or every second and the last.
    """
    require(lame.shape == shear.shape, "lame and shear differ in shape")
    require(numbered(lame.shape, 1), "lame has no cell along an axis, or too many")
    require(fixed.shape == tuple(n + 1 for n in lame.shape), "fixed is not over the nodes of the cells")
    return _galerkin(assembled(lame, shear, dilatation, distortion), fixed == 0, coarse)


def galerkin_of_stencil(stencil: Single, coarse: Lattice) -> Single:
    """Return the operator of a stencil over coarse nodes, as :func:`galerkin_of_cells` does of cells."""
    return _galerkin(to_sparse(stencil), stencil[0] > 0, coarse)


def _galerkin(matrix: Any, free: NDArray[np.bool_], coarse: Lattice) -> Single:
    from scipy.sparse import diags

    _require_coarser(free.shape, coarse)
    kept = free[np.ix_(*(nested(n, c) for n, c in zip(free.shape, coarse, strict=True)))]
    transfer = diags(np.tile(free.ravel(), 3).astype(float)) @ _prolongation(free.shape, coarse, nested=True)
    transfer = transfer @ diags(np.tile(kept.ravel(), 3).astype(float))
    return from_sparse(transfer.T @ matrix @ transfer, coarse)


def _prolongation(fine: tuple[int, ...], coarse: tuple[int, ...], *, nested: bool) -> Any:
    """Linear interpolation between the nodes of two grids, of each component."""
    from scipy.sparse import csr_matrix, kron

    axes = [csr_matrix(axis_transfer(f - 1, c - 1, nested)) for f, c in zip(fine, coarse, strict=True)]
    return kron(np.eye(3), kron(kron(axes[0], axes[1]), axes[2])).tocsr()


def _require_coarser(nodes: tuple[int, ...], coarse: tuple[int, ...]) -> None:
    alike = all(n >= 2 and c in (n, n // 2 + 1) for n, c in zip(nodes, coarse, strict=True))
    require(alike, "coarse has neither as many nodes along an axis nor every second of them")

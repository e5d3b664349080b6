"""NumPy twin of the core's elastic solver: the same iteration on assembled sparse matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..hexahedra import Level, free_nodes, stiffness, weigh_along
from .checks import numbered, require, require_spacing, same_length

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_COARSEST_STEPS, _HIGHEST_DEGREE = 30, 100
_POWER_ITERATIONS = 15
_MARGIN, _RANGE = 1.1, 20.0


def axis_transfer(fine: int, coarse: int) -> Array:
    """Return the linear interpolation (fine + 1, coarse + 1) between two divisions of an axis into cells."""
    at = np.arange(fine + 1) * (coarse / fine)
    first = np.minimum((at + 1e-9).astype(int), coarse - 1)
    second = np.maximum(at - first, 0.0)
    out = np.zeros((fine + 1, coarse + 1))
    out[np.arange(fine + 1), first] = 1 - second
    out[np.arange(fine + 1), first + 1] += second
    return out


class _Grid:
    """One level: its operator on the free nodes, and its smoothing."""

    def __init__(self, level: Level, pinned: list[bool], full: bool, degree: int) -> None:
        self.cells = level[1].shape
        self.shape = tuple(n + 1 for n in self.cells)
        self.all = stiffness(level, full)
        self.free = np.tile(free_nodes(self.cells, pinned).ravel(), 3)
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
    """

    def __init__(
        self, levels: list[Level], pinned: list[bool], full: bool, degree: int, coarse_inverse: Single
    ) -> None:
        from scipy.sparse import kron

        for spacing, lame, shear in levels:
            require(lame.shape == shear.shape, "lame and shear differ in shape")
            require(numbered(lame.shape, 1), "lame has no cell along an axis, or too many")
            require_spacing(spacing)
        n = coarse_inverse.shape[0]
        require(coarse_inverse.shape == (n, n), "coarse_inverse is not square")
        require(len(levels) > 0, "levels is empty")
        require(1 <= degree <= _HIGHEST_DEGREE, "degree is not between 1 and 100")
        require(
            n in (0, 3 * free_nodes(levels[-1][1].shape, pinned).sum()),
            "coarse_inverse is neither empty nor over the free unknowns of the last level",
        )
        last = len(levels) - 1
        self._grids = [
            _Grid(level, pinned, full, _COARSEST_STEPS if i == last else degree) for i, level in enumerate(levels)
        ]
        self._coarse_inverse = coarse_inverse.astype(float)
        self._prolongations = []
        for fine, coarse in zip(self._grids[:-1], self._grids[1:], strict=True):
            axes = [axis_transfer(*pair) for pair in zip(fine.cells, coarse.cells, strict=True)]
            scalar = kron(kron(axes[0], axes[1]), axes[2])
            self._prolongations.append(kron(np.eye(3), scalar).tocsr()[fine.free][:, coarse.free])

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
        r = b - grid.matrix @ u
        errors, sound, direction, old = [], True, np.zeros_like(u), 1.0

        def note(missing: Array) -> None:
            lacking, found = (np.linalg.norm(v.reshape(3, -1), axis=0).sum() for v in (missing, u))
            errors.append(0.0 if lacking == 0 else float(lacking / found) if found > 0 else 1.0)

        for iteration in range(iterations):
            z = self._cycle(0, r)
            size = float(r @ z)
            direction = z + (size / old * direction if iteration else 0)
            ahead = grid.matrix @ direction
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
        grid = self._grids[0]
        self._check(values)
        return (grid.all @ values.reshape(-1).astype(float)).astype(np.float32).reshape(values.shape)

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


def line_load(
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    origin: Array,
    direction: Array,
    places: Array,
    changes: Array,
    depth: float,
    tip: float,
    width: float,
) -> Single:
    """Return the nodal load (3, nx, ny, nz) of a smoothed line force: its integrals times the hat functions.

    The force per length along the line through ``origin`` changes by ``changes`` at
    ``places``, and a force ``tip`` acts at ``depth``; all of it is smoothed by a Gaussian of
    ``width`` in three dimensions.
    """
    from scipy.special import erf

    require(numbered(shape, 1), "shape has no node along an axis, or too many")
    require_spacing(spacing)
    same_length("places", places, "changes", changes)
    require(np.isfinite(width) and width > 0, "width is not a length above 0")
    axes = [np.arange(n) * h - o for n, h, o in zip(shape, spacing, origin, strict=True)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"))
    along = np.tensordot(direction, place, axes=1)
    squared = ((place - np.multiply.outer(direction, along)) ** 2).sum(axis=0)
    shaft = 0.5 * erf((along[..., None] - places) / (width * np.sqrt(2))) @ changes
    end = tip * np.exp(-0.5 * ((along - depth) / width) ** 2) / (width * np.sqrt(2 * np.pi))
    force = (shaft + end) * np.exp(-0.5 * squared / width**2) / (2 * np.pi * width**2)
    for axis, h in enumerate(spacing):
        force = weigh_along(force, axis, h)
    return np.multiply.outer(direction, force).astype(np.float32)

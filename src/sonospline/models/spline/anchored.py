"""The spline's system with a fixed base eliminated: positive definite, and able to grow.

Some landmarks never change: at least four corners, at most every node of the pinned faces.
With their kernel matrix K_bb and affine rows R_b, b(x) = (K(x, base), 1, x) and the
symmetric matrix M = [[K_bb, R_b], [R_b^T, 0]], the reduced kernel

    G(x, y) = K(x, y) - b(x) . M^-1 b(y)

vanishes on the base and is definite (up to its sign) everywhere else. The paper's
indefinite matrix (6) thus becomes a Cholesky factor, and a landmark costs one row of it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import _core
from ...fields.kernel import Kernel

Array = NDArray[np.float64]

_SMALLEST_PIVOT = 1e-11
"""Coincident landmarks leave rounding here; neighbours on the finest lattices a thousand times more."""
_LARGEST_ERROR = 1e-8
"""Of an entry of the corners' matrix times its inverse."""
_WORTH_THREADS = 20_000_000
_ONE_THREAD = 60_000
"""Multiplications: of a product for which spinning threads pay, and for which BLAS starts none."""
_CHECKED = 4
"""About so many landmarks have their equation checked after a solve."""


class Base(ABC):
    """Landmarks that stay: what the reduced kernel needs to know of them."""

    size: int
    """Number of landmarks of the base."""

    @abstractmethod
    def columns(self, points: Array) -> Array:
        """Return b(x) for points (m, 3), as (m, size + 4)."""

    @abstractmethod
    def solve(self, columns: Array) -> Array:
        """Return M^-1 applied to each row of (m, size + 4)."""


class CornerBase(Base):
    """Four landmarks that span a tetrahedron; they carry the affine part and nothing else.

    LinAlgError where it is so flat or so far from the other landmarks that double precision loses it.
    """

    def __init__(self, kernel: Kernel, corners: Array, diagonal: float) -> None:
        self.size = len(corners)
        self._kernel = kernel
        self._corners = corners
        matrix = np.zeros((8, 8))
        matrix[:4, :4] = kernel.matrix(corners, corners) + kernel.sign * diagonal * np.eye(4)
        matrix[:4, 4:] = np.column_stack([np.ones(4), corners])
        matrix[4:, :4] = matrix[:4, 4:].T
        self._inverse = np.linalg.inv(matrix)
        if np.abs(matrix @ self._inverse - np.eye(8)).max() > _LARGEST_ERROR:
            raise np.linalg.LinAlgError("the corners span no tetrahedron to speak of")

    def columns(self, points: Array) -> Array:
        columns = np.empty((len(points), 8))
        columns[:, :4] = self._kernel.matrix(points, self._corners)
        columns[:, 4] = 1
        columns[:, 5:] = points
        return columns

    def solve(self, columns: Array) -> Array:
        return columns @ self._inverse


class _Rows:
    """Rows that come and go at the end, and are copied only when their room doubles."""

    def __init__(self, width: int) -> None:
        self._room = np.empty((64, width))
        self.all = self._room[:0]

    def append(self, rows: Array) -> None:
        count = len(self.all) + len(rows)
        if count > len(self._room):
            room = np.empty((max(count, 2 * len(self._room)), rows.shape[1]))
            room[: len(self.all)] = self.all
            self._room = room
        self._room[len(self.all) : count] = rows
        self.all = self._room[:count]

    def truncate(self, count: int) -> None:
        self.all = self.all[:count]


def _subtract_product(rows: Array, columns: Array, solved: Array) -> None:
    """``rows -= columns @ solved.T``; a small product stays on this thread.

    The threads of a BLAS spin for milliseconds after their work, on the very processors
    that the core's threads then need.
    """
    whole = rows.size * columns.shape[1]
    height = len(rows) if whole > _WORTH_THREADS else max(1, _ONE_THREAD // max(1, whole // max(1, len(rows))))
    for start in range(0, len(rows), max(1, height)):
        part = slice(start, start + height)
        rows[part] -= columns[part] @ solved.T


class Solution(NamedTuple):
    """Weights and affine part of one solve."""

    base_weights: Array
    """(b, 3)"""
    weights: Array
    """(n, 3)"""
    affine: Array
    """(4, 3)"""


class AnchoredSystem:
    """K w + R a = v, R^T w = 0 for a base and a growing list of other landmarks.

    Parameters
    ----------
    kernel : Kernel
        K.
    base : Base
        The landmarks that stay.
    diagonal : float
        Added to the diagonal of ``kernel.sign * K``; above zero it regularises.
    """

    def __init__(self, kernel: Kernel, base: Base, diagonal: float) -> None:
        self.base_size = base.size
        self._kernel = kernel
        self._base = base
        self._diagonal = diagonal
        self._points = _Rows(3)
        self._columns = _Rows(base.size + 4)  # b of each landmark
        self._solved = _Rows(base.size + 4)  # M^-1 b of each landmark
        self._factor = _core.active.CholeskyFactor()
        self._batches: list[tuple[Array, int]] = []
        """Landmarks as they were added, and how many of each are left: a copy takes the same steps to the same bits."""

    def __reduce__(self) -> Any:
        return _with_batches, (self._kernel, self._base, self._diagonal, self._batches)

    def append(self, points: Array) -> None:
        """Add landmarks (m, 3), in O(m n^2); LinAlgError, and no change, where that would be singular."""
        known = len(self._points.all)
        columns = self._base.columns(points)
        self._points.append(points)
        self._columns.append(columns)
        self._solved.append(self._base.solve(columns))
        rows = self._kernel.matrix(points, self._points.all)
        _subtract_product(rows, columns, self._solved.all)
        if self._kernel.sign < 0:
            np.negative(rows, out=rows)
        if self._diagonal:
            np.einsum("ii->i", rows[:, known:])[:] += self._diagonal
        if not self._factor.append(rows, _SMALLEST_PIVOT):
            self.truncate(known)
            raise np.linalg.LinAlgError("a landmark coincides with another")
        self._batches.append((points, len(points)))

    def reserve(self, size: int) -> None:
        """Make room for so many landmarks at once."""
        self._factor.reserve(size)

    def truncate(self, size: int) -> None:
        """Drop the landmarks from number ``size`` on."""
        self._factor.truncate(size)
        for rows in (self._points, self._columns, self._solved):
            rows.truncate(size)
        before = np.cumsum([0, *(kept for _, kept in self._batches)])
        self._batches = [
            (points, min(kept, int(size - first)))
            for (points, kept), first in zip(self._batches, before, strict=False)
            if first < size
        ]

    def at_once(self, count: int) -> AnchoredSystem:
        """Return the system of the first ``count`` landmarks, factored in one batch."""
        system = AnchoredSystem(self._kernel, self._base, self._diagonal)
        system.append(self._points.all[:count].copy())
        return system

    def solve(self, at_base: Array, values: Array) -> Solution:
        """Solve for values (b, 3) at the base and (n, 3) at the first n other landmarks."""
        solved = self._solved.all[: len(values)]
        base_part = np.zeros((self._base.size + 4, 3))
        if at_base.any():
            values = values - solved[:, : self._base.size] @ at_base
            base_part = self._base.solve(np.hstack([at_base.T, np.zeros((3, 4))])).T
        first = int(np.argmax(values.ravel() != 0)) // 3 if len(values) else 0  # anchors come first, and are zero
        solution = np.ascontiguousarray(self._kernel.sign * values.T)
        self._factor.solve(solution, first)
        base_part -= (solution @ solved).T
        return Solution(base_part[: self._base.size], solution.T, base_part[self._base.size :])

    def residual(self, solution: Solution, values: Array) -> float:
        """Return how far some landmarks are from their values (n, 3), relative to the largest."""
        if not len(values) or not (largest := np.abs(values).max()):
            return 0.0
        some = slice(0, len(values), max(1, len(values) // _CHECKED))
        points = self._points.all[: len(values)]
        met = self._kernel.matrix(points[some], points) @ solution.weights
        columns = self._columns.all[: len(values)][some]
        met += columns[:, : self._base.size] @ solution.base_weights + columns[:, self._base.size :] @ solution.affine
        if self._diagonal:
            met += self._kernel.sign * self._diagonal * solution.weights[some]
        return float(np.abs(met - values[some]).max() / largest)


def _with_batches(kernel: Kernel, base: Base, diagonal: float, batches: list[tuple[Array, int]]) -> AnchoredSystem:
    system, size = AnchoredSystem(kernel, base, diagonal), 0
    for points, kept in batches:
        size += kept
        system.append(points)
        system.truncate(size)
    return system

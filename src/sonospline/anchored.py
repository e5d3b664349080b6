"""The spline's system with its affine part eliminated: positive definite, and able to grow.

Subtracting from a kernel its affine interpolant at four corners, in both arguments, leaves
a kernel that vanishes there and is definite (up to its sign) everywhere else:

    G(x, y) = K(x, y) - l(x).k(y) - k(x).l(y) + l(x).K_cc.l(y)

with l the barycentric coordinates for the corners, k the kernel to them and K_cc the kernel
among them. The paper's indefinite saddle-point matrix (6) thus becomes a Cholesky factor,
to which a landmark is appended by one row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _core
from .kernels import Kernel

Array = NDArray[np.float64]

_SMALLEST_PIVOT = 1e-14


class Solution(NamedTuple):
    """Weights and affine part of one solve."""

    corner_weights: Array
    """(4, 3)"""
    weights: Array
    """(n, 3)"""
    affine: Array
    """(4, 3)"""


class AnchoredSystem:
    """K w + R a = v, R^T w = 0 for four corners and a growing list of other landmarks.

    Parameters
    ----------
    kernel : Kernel
        K.
    corners : (4, 3) ndarray
        Landmarks that span a tetrahedron, coordinates of the order of one.
    diagonal : float
        Added to the diagonal of ``kernel.sign * K``; above zero it regularises.
    """

    def __init__(self, kernel: Kernel, corners: Array, diagonal: float) -> None:
        self._kernel = kernel
        self._diagonal = diagonal
        self._corners = corners
        self._among_corners = kernel.matrix(corners, corners) + kernel.sign * diagonal * np.eye(4)
        self._barycentric = np.linalg.inv(np.column_stack([np.ones(4), corners]))
        self._points = np.empty((0, 3))
        self._coordinates = np.empty((0, 4))
        self._to_corners = np.empty((0, 4))
        self._factor = _core.active.CholeskyFactor()

    @property
    def size(self) -> int:
        """Number of landmarks besides the corners."""
        return self._factor.size

    def append(self, points: Array) -> None:
        """Add landmarks (m, 3), in O(m n^2); ValueError where the system would be singular."""
        coordinates = np.column_stack([np.ones(len(points)), points]) @ self._barycentric
        to_corners = self._kernel.matrix(points, self._corners)
        all_points = np.concatenate([self._points, points])
        all_coordinates = np.concatenate([self._coordinates, coordinates])
        all_to_corners = np.concatenate([self._to_corners, to_corners])
        rows = self._kernel.matrix(points, all_points)
        rows -= coordinates @ all_to_corners.T
        rows += (coordinates @ self._among_corners - to_corners) @ all_coordinates.T
        rows *= self._kernel.sign
        np.einsum("ii->i", rows[:, self.size :])[:] += self._diagonal
        if not self._factor.append(rows, _SMALLEST_PIVOT):
            raise ValueError("points are too close to one another to be told apart; thin them out or set smoothing")
        self._points, self._coordinates, self._to_corners = all_points, all_coordinates, all_to_corners

    def truncate(self, size: int) -> None:
        """Drop the landmarks from number ``size`` on."""
        self._factor.truncate(size)
        self._points = self._points[:size]
        self._coordinates = self._coordinates[:size]
        self._to_corners = self._to_corners[:size]

    def refactor(self) -> None:
        """Factor everything anew."""
        points = self._points
        self.truncate(0)
        self.append(points)

    def solve(self, at_corners: Array, values: Array) -> Solution:
        """Solve for values (4, 3) at the corners and (n, 3) at the other landmarks."""
        if at_corners.any():
            values = values - self._coordinates @ at_corners
        first = int(np.argmax(values.any(axis=1))) if len(values) else 0  # anchors come first, and are zero
        solution = np.ascontiguousarray(self._kernel.sign * values.T)
        self._factor.solve(solution, first)
        corner_weights = -(solution @ self._coordinates).T
        # What the kernel sum leaves of the values at the corners is affine.
        sums = self._among_corners @ corner_weights + (solution @ self._to_corners).T
        return Solution(corner_weights, solution.T, self._barycentric @ (at_corners - sums))

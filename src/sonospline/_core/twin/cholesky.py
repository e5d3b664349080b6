"""The factor of the spline's system."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .checks import require

Array = NDArray[np.float64]


class CholeskyFactor:
    """A Cholesky factor that grows by rows and can be cut back."""

    def __init__(self) -> None:
        self._factor = np.zeros((0, 0))

    @property
    def size(self) -> int:
        """Rows factored so far."""
        return len(self._factor)

    def append(self, rows: Array, smallest_pivot: float) -> bool:
        """Append rows (m, size + m) of the matrix; False, and no change, at too small a pivot."""
        from scipy.linalg import solve_triangular

        old = self.size
        require(rows.shape[1] == old + len(rows), "rows is not (m, size + m)")
        left = solve_triangular(self._factor, rows[:, :old].T, lower=True).T
        try:
            corner = np.linalg.cholesky(rows[:, old:] - left @ left.T)
        except np.linalg.LinAlgError:
            return False
        if len(corner) and np.diag(corner).min() ** 2 <= smallest_pivot:
            return False
        self._factor = np.block([[self._factor, np.zeros((old, len(rows)))], [left, corner]])
        return True

    def reserve(self, rows: int) -> None:
        """Make room for so many rows at once; here nothing to do."""

    def truncate(self, size: int) -> None:
        """Drop all rows from ``size`` on."""
        self._factor = self._factor[:size, :size]

    def solve(self, x: Array, first: int = 0) -> None:
        """Solve A x = b in place for the first n rows: x (3, n) is zero before row ``first``."""
        from scipy.linalg import solve_triangular

        require(x.shape[1] <= self.size, "x is not (3, size) or shorter")
        require(0 <= first <= x.shape[1], "first is beyond the rows of x")
        factor = self._factor[: x.shape[1], : x.shape[1]]
        x[:, first:] = solve_triangular(factor[first:, first:], x[:, first:].T, lower=True).T
        x[:] = solve_triangular(factor, x.T, lower=True, trans="T").T

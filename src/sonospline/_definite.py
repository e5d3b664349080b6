"""Symmetric positive definite systems that know their condition."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALLEST_CONDITION = 1e-10
"""Reciprocal condition from which on a system is taken as it is: rounding then errs by 1e-6 at most."""
_BISECTIONS = 60


def factor(matrix: Array) -> tuple[Array, float]:
    """Return the lower Cholesky factor of a matrix and its reciprocal condition; 0 where it is not definite."""
    from scipy.linalg.lapack import dpocon, dpotrf

    lower, failed = dpotrf(matrix, lower=True, clean=False)
    if failed:
        return lower, 0.0
    reciprocal, _ = dpocon(lower, np.abs(matrix).sum(axis=0).max(), uplo="L")
    return lower, float(reciprocal)


def solve(matrix: Array, right: Array, *, most: float) -> Array:
    """Solve a system that is definite but for rounding, with an energy ``right . x`` of at most ``most``.

    A sound answer is that of the matrix. Where the reciprocal condition is below
    :data:`SMALLEST_CONDITION` or the energy above ``most``, the diagonal is lifted until neither is:
    of all answers with that energy it meets ``right`` best, and it comes continuously from the sound one.
    """
    from scipy import linalg

    if factor(matrix)[1] >= SMALLEST_CONDITION:
        found: Array = linalg.solve(matrix, right, assume_a="sym")
        if right @ found <= most:
            return found
    values, vectors = linalg.eigh((matrix + matrix.T) / 2)
    values += max(0.0, SMALLEST_CONDITION * values[-1] - values[0])
    parts = vectors.T @ right
    return vectors @ (parts / (values + _lift(values, parts, most)))


def _lift(values: Array, parts: Array, most: float) -> float:
    """Smallest lift of the eigenvalues at which the energy of an answer is at most ``most``."""

    def energy(lift: float) -> float:
        return float((parts**2 * values / (values + lift) ** 2).sum())

    if energy(0.0) <= most:
        return 0.0
    low, high = 0.0, float((parts**2).sum()) / (4 * most)  # values / (values + lift)^2 <= 1 / (4 lift)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if energy(middle) > most else (low, middle)
    return high

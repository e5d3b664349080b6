"""Forces within bounds that bring points to rest: a convex quadratic programme, by an interior point method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MOST_ITERATIONS = 100
_GAP, _RESIDUAL = 1e-20, 1e-13
"""Where it ends, forces being over their ranges: mean product of slack and multiplier, and largest residual."""
_ROUNDING = 1e-13
"""Of the largest compliance: added to each point's own, as rounding may have left an eigenvalue below zero."""
_GUESSES = 4
_STEP = 0.995
"""Of the way to where something is zero."""


def bounded_forces(compliance: Array, apart: Array, low: Array, high: Array) -> Array:
    """Return the forces (n,) that minimise f C f / 2 + apart f within bounds.

    With g = apart + C f that is g = 0 where a force is within its bounds, g >= 0 where it is at the lower
    one and g <= 0 where it is at the upper one: Coulomb's law of a step. What is at a bound is there to
    the last bit.

    Parameters
    ----------
    compliance : (n, n) ndarray
        C, symmetric, with no eigenvalue below zero.
    apart : (n,) ndarray
        How far points are beyond where they are to be without any force.
    low, high : (n,) ndarray
        Bounds, low <= high, finite.

    Raises
    ------
    RuntimeError
        It did not converge: a compliance with an eigenvalue below zero.

    Notes
    -----
    Mehrotra's predictor and corrector, *SIAM J. Optim.* 2 (1992) 575, on forces over their ranges. Compliances of
    points nearer than the load's width are singular to rounding, where a method that guesses which
    points stick has no safe pivot; here the barriers keep every system definite.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.fem.bounded_forces import bounded_forces
    >>> compliance = np.array([[2.0, 1.0], [1.0, 2.0]])
    >>> bounded_forces(compliance, np.array([-3.0, -1.5]), np.full(2, -1.0), np.full(2, 1.0)).round(9).tolist()
    [1.0, 0.25]
    """
    sliding = _all_at_bounds(compliance, apart, low, high)
    if sliding is not None:
        return sliding
    forces = low.astype(float)
    moving = high > low
    if moving.any():
        span, held = (high - low)[moving], compliance[moving] @ forces
        scaled = span[:, None] * compliance[np.ix_(moving, moving)] * span
        shares, at_low, at_high = _within_unit(scaled, span * (apart[moving] + held))
        found = low[moving] + span * shares
        forces[moving] = np.where(at_low, low[moving], np.where(at_high, high[moving], found))
    return forces


def _all_at_bounds(compliance: Array, apart: Array, low: Array, high: Array) -> Array | None:
    """The forces where none is within its bounds, as in most steps: a guess is checked sooner than forces are found."""
    forces = high
    for _ in range(_GUESSES):
        guess = np.where(apart + compliance @ forces <= 0, high, low)
        if (guess == forces).all():
            return guess
        forces = guess
    return None


def _within_unit(matrix: Array, linear: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Where in [0, 1] the programme has its minimum, and what is at either end."""
    from scipy.linalg.lapack import dpotrf

    scale = max(matrix.diagonal().max(), np.abs(linear).max())
    matrix = (matrix + matrix.T) / (2 * scale) + _ROUNDING * matrix.diagonal().max() / scale * np.eye(len(matrix))
    slacks = np.full((2, len(linear)), 0.5)  # from the lower and to the upper end
    forces = np.ones_like(slacks)  # of either end: the multipliers
    for _ in range(_MOST_ITERATIONS):
        residual = matrix @ slacks[0] + linear / scale - forces[0] + forces[1]
        gap = (slacks * forces).mean()
        if gap <= _GAP and np.abs(residual).max() <= _RESIDUAL:
            return slacks[0], *(slacks < forces)
        factor, failed = dpotrf(matrix + np.diag((forces / slacks).sum(axis=0)))
        if failed:
            break
        moves, pushes = _newton(factor, slacks, forces, residual, np.zeros_like(slacks))
        length = _longest(slacks, moves, forces, pushes)
        ahead = ((slacks + length * moves) * (forces + length * pushes)).mean()
        centred = gap * (ahead / gap) ** 3 - moves * pushes
        moves, pushes = _newton(factor, slacks, forces, residual, centred)
        length = _STEP * _longest(slacks, moves, forces, pushes)
        slacks, forces = slacks + length * moves, forces + length * pushes
    raise RuntimeError("the forces of contact did not converge; the compliance has an eigenvalue below zero")


def _newton(factor: Array, slacks: Array, forces: Array, residual: Array, products: Array) -> tuple[Array, Array]:
    """Changes of both that bring slack times force to given products, linearly, and the residual to zero."""
    from scipy.linalg.lapack import dpotrs

    wanted = products / slacks - forces
    move, _ = dpotrs(factor, wanted[0] - wanted[1] - residual)
    moves = np.stack([move, -move])
    return moves, wanted - forces / slacks * moves


def _longest(slacks: Array, moves: Array, forces: Array, pushes: Array) -> float:
    """Of a step, the part up to 1 that leaves nothing below zero."""
    fastest = max((-moves / slacks).max(), (-pushes / forces).max())
    return float(min(1.0, 1 / fastest)) if fastest > 0 else 1.0

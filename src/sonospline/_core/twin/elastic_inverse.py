"""NumPy twin of the core's elastic displacement between nodes, and of its inverse, at a few points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .checks import numbered, require, require_spacing, same_length

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_UNDAMPED = 8
_TOLERANCE = 3e-6
_REACH = 4
"""Nodes on either side of a cell; beyond, a value counts for a thousandth."""


def undeformed_points(
    displacement: Single,
    spacing: tuple[float, float, float],
    x: Array,
    y: Array,
    z: Array,
    points: Array,
    start: Array,
    iterations: int,
) -> Array:
    """Return the places (m, 3) that points of deformed tissue were at, along the grid's axes from its first node.

    Places p with p + u(p) = points, to 3e-6 of the shortest spacing; of points that no tissue of the box
    is at, near ones on its faces.

    Parameters
    ----------
    displacement : (3, nx, ny, nz) ndarray
        u at the nodes; a cubic spline between them.
    spacing
        Of the nodes.
    x, y, z : (n + 2, n) ndarray
        From values at the nodes of each axis to the coefficients of B-splines.
    points : (m, 3) ndarray
        In deformed tissue.
    start : (m, 3) ndarray
        Places to begin with.
    iterations : int
        At most.
    """
    _check(displacement, spacing, (x, y, z), points)
    same_length("start", start, "points", points)
    require(0 <= iterations <= 10_000, "iterations is not between 0 and 10000")
    sides, h = (np.array(displacement.shape[1:]) - 1) * np.array(spacing), np.array(spacing)
    found = np.clip(start, 0.0, sides)
    busy = np.arange(len(found))
    for iteration in range(iterations):
        moves = _displacement(displacement, (x, y, z), found[busy] / h)
        change = np.clip(points[busy] - moves, 0.0, sides) - found[busy]
        found[busy] += (1.0 if iteration < _UNDAMPED else 0.5) * change
        busy = busy[np.abs(change).max(axis=1) > _TOLERANCE * h.min()]
        if not len(busy):
            break
    return found


def displacement_at(
    displacement: Single, spacing: tuple[float, float, float], x: Array, y: Array, z: Array, points: Array
) -> Array:
    """Return the displacement (m, 3) at points along the grid's axes from its first node; beyond the box, at its faces.

    Parameters
    ----------
    displacement, spacing, x, y, z, points
        As for :func:`undeformed_points`.
    """
    _check(displacement, spacing, (x, y, z), points)
    h = np.array(spacing)
    return _displacement(displacement, (x, y, z), np.clip(points / h, 0.0, np.array(displacement.shape[1:]) - 1.0))


def _check(
    displacement: Single, spacing: tuple[float, float, float], filters: tuple[Array, Array, Array], points: Array
) -> None:
    shape = displacement.shape[1:]
    require(numbered(shape, 2), "displacement has fewer than two nodes along an axis, or too many")
    require_spacing(spacing)
    for n, matrix in zip(shape, filters, strict=True):
        require(matrix.shape == (n + 2, n), "x, y or z is not of the nodes of displacement and two more")
    require(bool(np.isfinite(points).all()), "points are not finite")


def _displacement(values: Single, filters: tuple[Array, Array, Array], places: Array) -> Array:
    """Displacement (m, 3) at places in spacings."""
    x, y, z = (_weights(places[:, a], matrix) for a, matrix in enumerate(filters))
    return np.einsum("aijk,pi,pj,pk->pa", values.astype(float), x, y, z, optimize=True)


def _weights(place: Array, matrix: Array) -> Array:
    """What the value at each node counts for in the spline (m, n)."""
    nodes = matrix.shape[1]
    cell = np.clip(np.floor(place), 0, nodes - 2).astype(int)
    t = (place - cell)[:, None]
    bumps = np.hstack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 3 * (1 - t) ** 3 - 6 * (1 - t) ** 2 + 4, t**3]) / 6
    weights = np.einsum("pi,pij->pj", bumps, matrix[cell[:, None] + np.arange(4)])
    away = np.arange(nodes) - cell[:, None]
    return np.where((away >= -_REACH) & (away <= _REACH + 1), weights, 0.0)

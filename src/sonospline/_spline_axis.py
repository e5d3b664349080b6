"""Cubic splines along one axis of a lattice, as matrices: B-spline coefficients and their sums.

The not-a-knot spline: cubic between nodes, its second derivative continuous, its third also
at the second and the last but one node. It reproduces cubics and asks nothing of the ends.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_NEGLIGIBLE = 1e-7
"""Entries of the inverse below this: they decay by 0.27 a node."""


@lru_cache(maxsize=32)
def filter_matrix(nodes: int) -> Array:
    """Return the matrix (nodes + 2, nodes) from values at nodes to B-spline coefficients.

    Coefficient i belongs to node i - 1: one more on either side.
    """
    system = np.zeros((nodes + 2, nodes + 2))
    for i in range(nodes):
        system[i, i : i + 3] = 1 / 6, 4 / 6, 1 / 6
    order = min(4, nodes)  # a difference of the coefficients that vanishes at either end
    difference = [(-1) ** k * comb(order, k) for k in range(order + 1)]
    system[nodes, : order + 1] = difference
    system[nodes + 1, -order - 1 :] = difference
    matrix = np.linalg.inv(system)[:, :nodes].astype(np.float64)
    matrix[np.abs(matrix) < _NEGLIGIBLE] = 0
    return matrix


def weights(nodes: int, position: float) -> Array:
    """Return the weights (nodes,) of the values at nodes in the value at one position, in spacings."""
    cell, of_coefficients = _bumps(nodes, np.array([position]))
    return of_coefficients[0] @ filter_matrix(nodes)[cell[0] : cell[0] + 4]


def sum_matrix(nodes: int, positions: Array) -> Array:
    """Return the matrix (m, nodes + 2) from B-spline coefficients to values at positions, in spacings.

    Beyond the nodes the spline keeps its end values.
    """
    cell, of_coefficients = _bumps(nodes, positions)
    matrix = np.zeros((len(cell), nodes + 2))
    np.put_along_axis(matrix, cell[:, None] + np.arange(4), of_coefficients, axis=1)
    return matrix


def _bumps(nodes: int, positions: Array) -> tuple[NDArray[np.int64], Array]:
    """The first of the four coefficients that count at each position, and their weights (m, 4)."""
    place = np.clip(positions, 0, nodes - 1)
    cell = np.minimum(place.astype(int), nodes - 2)
    t = place - cell
    of_coefficients = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
    return cell, np.stack(of_coefficients, axis=1) / 6


@lru_cache(maxsize=64)
def resampling(nodes: int, spacing: float, start: float, count: int, step: float) -> tuple[Single, Single]:
    """Return the weights of coefficients, and of values (transposed), at ``count`` places ``start + i step``."""
    to_places = sum_matrix(nodes, (start + step * np.arange(count, dtype=float)) / spacing)
    together = (to_places @ filter_matrix(nodes)).T
    return np.ascontiguousarray(to_places, np.float32), np.ascontiguousarray(together, np.float32)


def coefficients(values: NDArray[np.floating]) -> Single:
    """Return the B-spline coefficients (nx + 2, ny + 2, nz + 2, 3) of values (nx, ny, nz, 3)."""
    found = np.asarray(values, np.float32)
    for axis in range(3):
        matrix = filter_matrix(found.shape[axis]).astype(np.float32)
        first = np.ascontiguousarray(np.moveaxis(found, axis, 0))
        # einsum, not a BLAS product: that would wake all its threads, which on a busy machine cost ten times the sum.
        product = np.einsum("ij,jm->im", matrix, first.reshape(len(first), -1))
        found = np.moveaxis(product.reshape(-1, *first.shape[1:]), 0, axis)
    return np.ascontiguousarray(found)

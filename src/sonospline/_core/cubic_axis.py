"""Cubic splines along one axis of a lattice, as matrices: B-spline coefficients and their sums.

The not-a-knot spline: cubic between nodes, its second derivative continuous, its third also
at the second and the last but one node. It reproduces cubics and asks nothing of the ends.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb
from typing import Any

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
    # diagonally dominant but for its two end rows: its condition is at most 98, whatever the number of nodes
    matrix = np.linalg.inv(system)[:, :nodes].astype(np.float64)
    matrix[np.abs(matrix) < _NEGLIGIBLE] = 0
    return matrix


def weights(nodes: int, position: float) -> Array:
    """Return the weights (nodes,) of the values at nodes in the value at one position, in spacings."""
    place = min(max(position, 0.0), nodes - 1.0)
    cell = min(int(place), nodes - 2)
    return np.array(_bumps(place - cell)) @ filter_matrix(nodes)[cell : cell + 4]


def sum_matrix(nodes: int, positions: Array) -> Array:
    """Return the matrix (m, nodes + 2) from B-spline coefficients to values at positions, in spacings.

    Beyond the nodes the spline keeps its end values.
    """
    place = np.clip(positions, 0, nodes - 1)
    cell = np.minimum(place.astype(int), nodes - 2)
    matrix = np.zeros((len(place), nodes + 2))
    np.put_along_axis(matrix, cell[:, None] + np.arange(4), np.stack(_bumps(place - cell), axis=1), axis=1)
    return matrix


def _bumps(t: Any) -> list[Any]:
    """Weights of the four coefficients around a place at share t of its cell."""
    return [(1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6]


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

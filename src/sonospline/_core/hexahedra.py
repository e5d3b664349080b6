"""Trilinear hexahedra: the stiffness of cells and grids, which nodes move, and loads on nodes.

The strain energy of a trilinear cell is a sum of squares of its Walsh-Hadamard modes: with
X_m the sum over the corners of u_x times the sign of the mode m, a = 1 / side and V the
volume, the energy is V/32 times

    lame  [ D^2 + full/3 (e1^2 + e2^2 + e3^2) + full/9 (...) ]
    + shear [ squares of the strains' constant, linear and bilinear parts ]

so that a matrix of a cell is ``lame * dilatation(spacing) + shear * distortion(spacing)``.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Level = tuple[tuple[float, float, float], Single, Single]
"""Spacing, and the Lamé moduli of each cell (cx, cy, cz)."""

_CORNERS = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
_SIGNS = 2 * _CORNERS - 1


@lru_cache(maxsize=64)
def cell_matrices(spacing: tuple[float, float, float], full: bool) -> tuple[Array, Array]:
    """Return the 24 x 24 stiffness of a cell for a unit first and second Lamé modulus.

    Unknowns are ordered (component, corner), corners z fastest. ``full`` integrates the
    dilatation over the cell instead of taking its mean (B-bar).
    """
    inverse, volume = 1 / np.array(spacing), float(np.prod(spacing))
    linear = {axis: _SIGNS[:, axis] for axis in range(3)}
    product = {(a, b): _SIGNS[:, a] * _SIGNS[:, b] for a in range(3) for b in range(a + 1, 3)}
    bubble = _SIGNS.prod(axis=1)

    def derivative(of: int, along: int) -> list[tuple[int, Array]]:
        """d u_of / d x_along as (1, xi_b, xi_c, xi_b xi_c) parts: weight of the square, row of 24."""
        b, c = (axis for axis in range(3) if axis != along)
        parts = []
        for key, sign in (
            (0, linear[along]),
            (1 + b, product[min(along, b), max(along, b)]),
            (1 + c, product[min(along, c), max(along, c)]),
            (4 + along, bubble),
        ):
            row = np.zeros(24)
            row[8 * of : 8 * of + 8] = inverse[along] * sign
            parts.append((key, row))
        return parts

    def squares(terms: list[list[tuple[int, Array]]]) -> Array:
        """Mean over the cell of the square of a sum of derivatives, as a matrix."""
        rows: dict[int, Array] = {}
        for parts in terms:
            for key, row in parts:
                rows[key] = rows.get(key, np.zeros(24)) + row
        mean = {0: 1.0, **dict.fromkeys((1, 2, 3), 1 / 3), **dict.fromkeys((4, 5, 6), 1 / 9)}
        return sum((mean[key] * np.outer(row, row) for key, row in rows.items()), np.zeros((24, 24)))

    trace = [derivative(a, a) for a in range(3)]
    if not full:
        trace = [[(key, row) for key, row in parts if key == 0] for parts in trace]
    distortion = sum((2 * squares([derivative(a, a)]) for a in range(3)), np.zeros((24, 24)))
    for a, b in ((0, 1), (0, 2), (1, 2)):
        distortion = distortion + squares([derivative(a, b), derivative(b, a)])
    return volume / 16 * squares(trace), volume / 16 * distortion


def stiffness(level: Level, full: bool) -> Any:
    """Return the assembled operator of a level as a sparse matrix over (component, node)."""
    spacing, lame, shear = level
    return assembled(lame, shear, *cell_matrices(tuple(map(float, spacing)), full))


def assembled(lame: Single, shear: Single, dilatation: Array, distortion: Array) -> Any:
    """Return the operator of cells with such moduli, whose matrices for unit ones are given."""
    from scipy.sparse import coo_matrix

    shape = tuple(n + 1 for n in lame.shape)
    nodes = np.arange(np.prod(shape)).reshape(shape)
    cx, cy, cz = lame.shape
    corner = np.stack([nodes[i : cx + i, j : cy + j, k : cz + k].ravel() for i, j, k in _CORNERS], axis=1)
    local = np.concatenate([corner + a * nodes.size for a in range(3)], axis=1)
    entries = (
        lame.ravel().astype(float)[:, None, None] * dilatation + shear.ravel().astype(float)[:, None, None] * distortion
    )
    rows, columns = np.repeat(local, 24, axis=1), np.tile(local, (1, 24))
    return coo_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * nodes.size,) * 2).tocsr()


def layer_stiffness(
    shape: tuple[int, ...], spacing: tuple[float, float, float], layered: NDArray[np.int64], excess: Array | Single
) -> Any:
    """Return what layers add to the operator of a level, as a sparse matrix over (component, node).

    ``excess`` (n, 6, 6) resists the mean strain of the cells ``layered`` (n, 3).
    """
    from scipy.sparse import coo_matrix

    nodes = np.arange(np.prod(shape)).reshape(shape)
    corner = np.stack([nodes[tuple((layered + corner).T)] for corner in _CORNERS], axis=1)
    local = np.concatenate([corner + a * nodes.size for a in range(3)], axis=1)
    strain = mean_strain(spacing)
    entries = float(np.prod(spacing)) * np.einsum("ia,nij,jb->nab", strain, excess, strain, optimize=True)
    rows, columns = np.repeat(local, 24, axis=1), np.tile(local, (1, 24))
    return coo_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * nodes.size,) * 2).tocsr()


def mean_strain(spacing: tuple[float, float, float]) -> Array:
    """Return the mean strain (6, 24) of a cell for its unknowns: xx, yy, zz, yz, xz, xy, engineering shear strains."""
    slopes = _SIGNS / (4 * np.array(spacing))
    strain = np.zeros((6, 3, 8))
    for a in range(3):
        strain[a, a] = slopes[:, a]
    for row, (a, b) in enumerate(((1, 2), (0, 2), (0, 1)), 3):
        strain[row, a], strain[row, b] = slopes[:, b], slopes[:, a]
    return strain.reshape(6, 24)


def free_nodes(cells: tuple[int, ...], pinned: list[bool]) -> NDArray[np.bool_]:
    """Return which nodes of a level may move, for pinned faces x-, x+, y-, y+, z-, z+."""
    free = np.ones([n + 1 for n in cells], bool)
    for axis in range(3):
        along = np.moveaxis(free, axis, 0)
        along[0] &= not pinned[2 * axis]
        along[-1] &= not pinned[2 * axis + 1]
    return free


def weigh_along(values: Array, axis: int, spacing: float) -> Array:
    """Return the integrals of a function times each hat function along one axis, from its nodal values.

    Numerov's weights 1, 10, 1 over 12: exact for cubics between, where the consistent mass of
    linear elements smooths the function once more. They keep the total of the trapezoidal rule.
    """
    lines = np.moveaxis(values, axis, 0)
    out = 10.0 * lines
    out[[0, -1]] = 5.0 * lines[[0, -1]]
    out[1:] += lines[:-1]
    out[:-1] += lines[1:]
    return np.moveaxis(out * spacing / 12, 0, axis)

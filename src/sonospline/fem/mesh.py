"""The finite elements on a grid's own nodes: hexahedra, or six tetrahedra in each."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..geometry.grid import Grid

Index = NDArray[np.int64]

ELEMENTS = ("hexahedron", "tetrahedron")
"""Eight nodes, trilinear (Q1); four nodes, linear (P1)."""


def cells(grid: Grid, element: str) -> Index:
    """Return node numbers (cells, 8 or 4), in the order of ``grid.points``.

    The corners of a hexahedron come in tensor-product order, x fastest. The tetrahedra
    are Kuhn's: each follows the three axes, in one of the six orders, from a cell's first
    corner to its opposite one, so that neighbouring cells fit.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.fem.mesh import cells
    >>> cells(ss.Grid.unit_cube(2), "hexahedron").tolist()
    [[0, 4, 2, 6, 1, 5, 3, 7]]
    >>> cells(ss.Grid.unit_cube(3), "tetrahedron").shape
    (48, 4)
    """
    _validate.choice("element", element, ELEMENTS)
    numbers = np.arange(grid.node_count).reshape(grid.shape)
    first = numbers[:-1, :-1, :-1].ravel()
    steps = numbers[1, 0, 0], numbers[0, 1, 0], numbers[0, 0, 1]
    corners = np.array([i * steps[0] + j * steps[1] + k * steps[2] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
    if element == "hexahedron":
        return first[:, None] + corners
    paths = np.array([[0, *np.cumsum([1 << axis for axis in order])] for order in permutations(range(3))])
    return (first[:, None, None] + corners[paths]).reshape(-1, 4)

"""The stiffness of every cell of a grid by itself: what history that each cell has of its own needs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid
from ..mechanics.layers import Layers
from ..mechanics.moduli import Moduli
from .engine import System
from .mesh import cells
from .scikit_assembly import assemble

Array = NDArray[np.float64]

_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T


def cell_corners(grid: Grid) -> NDArray[np.int64]:
    """Return the node numbers (cells, 8) of each cell's corners, the last axis fastest."""
    numbers = np.arange(grid.node_count).reshape(grid.shape)
    steps = np.array([numbers[tuple(corner)] for corner in _CORNERS])
    return numbers[:-1, :-1, :-1].reshape(-1, 1) + steps


def cell_stiffness(moduli: Moduli) -> Array:
    """Return the stiffness (cells, 24, 24) of each cell: trilinear hexahedra with their mean dilatation.

    Rows and columns go by the corners as :func:`cell_corners` has them, and by the grid's axes at each.
    All cells are the same box, so that scikit-fem integrates one of them.
    """
    sides = np.array(moduli.grid.spacing)
    box = Grid(shape=(2, 2, 2), spacing=sides)
    distortion = _of_one_cell(box, 0.0)
    dilatation = _of_one_cell(box, 1.0) - distortion
    lame, shear = (values.reshape(-1, 1, 1) for values in moduli.lame_moduli)
    stiffness: Array = lame * dilatation + shear * distortion
    layers: Layers = moduli.layers
    layered = np.ravel_multi_index(tuple(layers.cells.T), moduli.shear.shape)
    strain = _mean_strain(sides)
    stiffness[layered] += np.prod(sides) * strain.T @ layers.excess @ strain
    held = np.ravel_multi_index(tuple(moduli.bone.cells.T), moduli.shear.shape)
    springs = moduli.bone.at_corners(moduli.lame, moduli.shear, moduli.grid.spacing)
    stiffness[held[:, None], np.arange(24), np.arange(24)] += springs.reshape(-1, 24)
    return stiffness


def _of_one_cell(box: Grid, lame: float) -> Array:
    """Of a unit shear modulus."""
    one = Moduli(box, np.full((1, 1, 1), lame), np.ones((1, 1, 1)))
    nowhere = np.zeros(8, bool)
    system = System(box.points, cells(box, "hexahedron"), nowhere, one, "mean_dilatation", "direct", 1e-12)
    stiffness: Array = assemble(system).stiffness.toarray()
    return stiffness


def _mean_strain(sides: Array) -> Array:
    """Mean strain (6, 24) of a cell by its corners' displacements: xx, yy, zz, and twice yz, xz, xy."""
    slopes = (2 * _CORNERS - 1) / (4 * sides)
    strain = np.zeros((6, 8, 3))
    for row, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))):
        strain[row, :, a] = slopes[:, b]
        strain[row, :, b] = slopes[:, a]
    return strain.reshape(6, 24)

"""Forces on the nodes of the solver's grid, from the load objects every model shares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core.hexahedra import weigh_along
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from .loads import LineLoad, Load

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def nodal_load(load: Load, needle: Needle, grid: Grid) -> Single:
    """Return the forces (3, nx, ny, nz) on a grid's nodes, along its axes.

    They are the integrals of the force per volume times the hat functions, by Numerov's weights.
    """
    if isinstance(load, LineLoad):
        return _line_load(load, needle, grid)
    local = load.body_force(grid.points, needle) @ grid.direction
    forces = np.moveaxis(local.reshape(*grid.shape, 3), -1, 0)
    for axis, spacing in enumerate(grid.spacing):
        forces = weigh_along(forces, axis + 1, spacing)
    return np.ascontiguousarray(forces, np.float32)


def _line_load(load: LineLoad, needle: Needle, grid: Grid) -> Single:
    """A line force is the same Gaussian around every point of its axis: only the axis is asked."""
    force = load.along(needle)
    return _core.active.line_load(
        grid.shape,
        grid.spacing,
        grid.local(needle.entry),
        needle.direction @ grid.direction,
        force.places,
        force.changes,
        needle.depth,
        force.tip,
        load.width,
    )

"""Forces on the nodes of the solver's grid, from the load objects every model shares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core.twin_elastic import mass_along
from ..fem.loads import LineForce, Load
from ..grid import Grid
from ..needle import Needle

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_REACH = 6.0
_PER_WIDTH, _FINER = 12, 4
"""Values of a profile in the width of a line force, and pieces that cubics make of each interval: linear between
those to 5e-5 of the peak."""


def nodal_load(load: Load, needle: Needle, grid: Grid) -> Single:
    """Return the forces (3, nx, ny, nz) on a grid's nodes, along its axes.

    The force per volume is taken linear between the nodes and weighed with the consistent
    mass matrix, as the reference solution does.
    """
    if isinstance(load, LineForce):
        return _line_load(load, needle, grid)
    local = load.body_force(grid.points, needle) @ grid.direction
    forces = np.moveaxis(local.reshape(*grid.shape, 3), -1, 0)
    for axis, spacing in enumerate(grid.spacing):
        forces = mass_along(forces, axis + 1, spacing)
    return np.ascontiguousarray(forces, np.float32)


def _line_load(load: LineForce, needle: Needle, grid: Grid) -> Single:
    """A line force is the same Gaussian around every point of its axis: only the axis is asked."""
    interval = load.width / _PER_WIDTH
    first = -_REACH * load.width
    count = int((needle.depth - 2 * first) / interval) + 4
    along = first + interval * np.arange(count)
    axis = needle.entry + along[:, None] * needle.direction
    profile = load.body_force(axis, needle) @ needle.direction
    return _core.active.line_load(
        grid.shape,
        grid.spacing,
        tuple(grid.local(needle.entry[None])[0].tolist()),
        tuple((needle.direction @ grid.direction).tolist()),
        _refined(profile),
        first + interval,
        interval / _FINER,
        load.width,
    )


def _refined(values: Array) -> Single:
    """Values at quarters of the intervals by cubics through four neighbours, from the second value on."""
    t = np.arange(_FINER)[:, None] / _FINER
    weights = np.hstack([
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    ])  # fmt: skip
    neighbours = np.lib.stride_tricks.sliding_window_view(values, 4)
    return np.ascontiguousarray(neighbours @ weights.T, np.float32).ravel()

"""A displacement of nodes between them, a cubic spline, and where its points were before they moved.

Points are along the axes of the grid, from its first node on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core import cubic_axis
from ..geometry.grid import Grid

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def displacement_at(displacement: Single, grid: Grid, points: Array) -> Array:
    """Return the displacement (m, 3) at points (m, 3), of nodes (3, nx, ny, nz)."""
    found: Array = _core.active.displacement_at(displacement, grid.spacing, *_filters(grid), points)
    return found


def undeformed(displacement: Single, grid: Grid, points: Array, start: Array, iterations: int) -> Array:
    """Return where the tissue (m, 3) that is at points now was, sought from a start by so many iterations at most."""
    found: Array = _core.active.undeformed_points(
        displacement, grid.spacing, *_filters(grid), points, start, iterations
    )
    return found


def _filters(grid: Grid) -> list[Array]:
    return [cubic_axis.filter_matrix(n) for n in grid.shape]

"""What the 3-D view is drawn of: meshes, and the nets that every tissue has, its skin and grid lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid
from .skin_frame import SkinFrame

Array = NDArray[np.float64]
Index = NDArray[np.uint32]

MOST_VERTICES = 8000
_SKIN_CELLS, _LINE_MM, _LINE_STEP_MM = 24, 10.0, 5.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Triangles or lines of the 3-D view, in undeformed tissue."""

    name: str
    kind: Literal["surface", "lines"]
    """``surface`` (triangles) or ``lines`` (pairs)."""
    colour: str
    opacity: float
    points: Array
    """(vertices, 3) world positions."""
    indices: Index
    """(m, 3) or (m, 2) vertices of each triangle or line."""


def skin(grid: Grid, face: str, frame: SkinFrame) -> Mesh:
    """Return the entry face as a net of triangles."""
    corners = grid.world(_face_corners(grid, face))
    across, along = corners[1] - corners[0], corners[2] - corners[0]
    n = _SKIN_CELLS + 1
    s, t = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    points = corners[0] + s.reshape(-1, 1) * across + t.reshape(-1, 1) * along
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    order = (a, b, c, a, c, d) if np.cross(across, along) @ frame.depth < 0 else (a, c, b, a, d, c)
    triangles = np.stack(order, axis=1).reshape(-1, 3)
    return Mesh(
        name="skin", kind="surface", colour="#8d7a70", opacity=0.55, points=points, indices=triangles.astype(np.uint32)
    )


def grid_lines(grid: Grid, frame: SkinFrame) -> Mesh:
    """Return lines a centimetre apart in the plane of the rest image, which bend as the tissue does."""
    normal_axis = int(np.argmax(np.abs(grid.direction.T @ frame.out)))
    across = [axis for axis in range(3) if axis != normal_axis]
    start = grid.local(frame.origin[None])[0]
    points: list[Array] = []
    pairs: list[NDArray[np.int64]] = []
    for run, other in (across, across[::-1]):
        steps = np.linspace(0, grid.extent[run], max(2, round(grid.extent[run] / _LINE_STEP_MM) + 1))
        for place in np.linspace(0, grid.extent[other], max(2, round(grid.extent[other] / _LINE_MM) + 1)):
            line = np.tile(start, (len(steps), 1))
            line[:, run], line[:, other] = steps, place
            first = sum(map(len, points))
            points.append(grid.world(line))
            pairs.append(first + np.column_stack([np.arange(len(steps) - 1), np.arange(1, len(steps))]))
    return Mesh(
        name="grid", kind="lines", colour="#8a949f", opacity=0.8, points=np.concatenate(points),
        indices=np.concatenate(pairs).astype(np.uint32),
    )  # fmt: skip


def _face_corners(grid: Grid, face: str) -> Array:
    """First corner of a face and its two neighbours, in the lattice's coordinates."""
    from ..geometry.grid import FACES

    axis, end = divmod(FACES.index(face), 2)
    corner = np.zeros(3)
    corner[axis] = grid.extent[axis] if end else 0.0
    corners = np.stack([corner] * 3)
    for number, other in enumerate(a for a in range(3) if a != axis):
        corners[number + 1, other] = grid.extent[other]
    return corners

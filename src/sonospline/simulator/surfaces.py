"""Organ surfaces for the 3-D view, from a label map."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from ..grid import Grid
from ..volume import Volume
from .scene_file import SurfacePart
from .skin_frame import SkinFrame

Array = NDArray[np.float64]
Index = NDArray[np.uint32]

MOST_VERTICES = 8000
_SOFTEN_VOXELS = 0.8
_SMOOTHING_PASSES, _PASS_BAND = 15, 0.1
_SKIN_CELLS, _LINE_MM, _LINE_STEP_MM = 24, 10.0, 5.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Triangles or lines of the 3-D view, in undeformed tissue."""

    name: str
    kind: str
    """``surface`` (triangles) or ``lines`` (pairs)."""
    colour: str
    opacity: float
    points: Array
    """(vertices, 3) world positions."""
    indices: Index
    """(m, 3) or (m, 2) vertices of each triangle or line."""


def organ(labels: Volume, names: dict[int, str], part: SurfacePart, *, most: int) -> Mesh | None:
    """Return the surface around the labels a part names; None where none of them occurs."""
    chosen = [n for n, name in names.items() if any(fnmatchcase(name, pattern) for pattern in part.tissues)]
    inside = np.isin(labels.voxels, chosen)
    if not inside.any():
        return None
    window, first = _window(inside)
    points, triangles = _contour(_soft(window), most)
    if not len(points):
        return None
    return Mesh(
        name=part.name, kind="surface", colour=part.colour, opacity=part.opacity,
        points=labels.position(points + first), indices=triangles,
    )  # fmt: skip


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


def _window(inside: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Array]:
    """What a mask holds, with two voxels of margin (padded where the map ends), and its first voxel."""
    held = [np.flatnonzero(inside.any(axis=tuple(a for a in range(3) if a != axis))) for axis in range(3)]
    cut = inside[tuple(slice(h[0], h[-1] + 1) for h in held)]
    return np.pad(cut, 2), np.array([h[0] for h in held]) - 2.0


def _soft(inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(inside.astype(np.float32), _SOFTEN_VOXELS)


def _contour(values: NDArray[np.float32], most: int) -> tuple[Array, Index]:
    """The half-way surface of a soft mask, smooth and of at most so many vertices, in voxels."""
    arrays = require("vtkmodules.util.numpy_support")
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D, vtkQuadricDecimation, vtkWindowedSincPolyDataFilter

    image = vtkImageData()
    image.SetDimensions(values.shape)
    image.GetPointData().SetScalars(arrays.numpy_to_vtk(np.ascontiguousarray(values.T).ravel()))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, 0.5)
    edges.ComputeNormalsOff()
    edges.Update()
    if not edges.GetOutput().GetNumberOfPolys():  # thinner than the map resolves
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint32)
    smooth = vtkWindowedSincPolyDataFilter()
    smooth.SetInputConnection(edges.GetOutputPort())
    smooth.SetNumberOfIterations(_SMOOTHING_PASSES)
    smooth.SetPassBand(_PASS_BAND)
    smooth.BoundarySmoothingOff()
    smooth.Update()
    surface = smooth.GetOutput()
    if surface.GetNumberOfPoints() > most:
        fewer = vtkQuadricDecimation()
        fewer.SetInputData(surface)
        fewer.SetTargetReduction(1 - most / surface.GetNumberOfPoints())
        fewer.Update()
        surface = fewer.GetOutput()
    points = arrays.vtk_to_numpy(surface.GetPoints().GetData()).astype(np.float64)
    triangles = arrays.vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.uint32)
    return points, triangles


def _face_corners(grid: Grid, face: str) -> Array:
    """First corner of a face and its two neighbours, in the lattice frame."""
    from ..grid import FACES

    axis, end = divmod(FACES.index(face), 2)
    corner = np.zeros(3)
    corner[axis] = grid.extent[axis] if end else 0.0
    corners = np.stack([corner] * 3)
    for number, other in enumerate(a for a in range(3) if a != axis):
        corners[number + 1, other] = grid.extent[other]
    return corners

"""Organ surfaces for the 3-D view, from a label map; kept between runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from .._cache import digest, keep, place, recall
from .._extras import require
from ..geometry.volume import Volume
from .scene_file import SurfacePart
from .surfaces import Array, Index, Mesh

_SOFTEN_VOXELS = 0.8
_SMOOTHING_PASSES, _PASS_BAND = 15, 0.1
_SOURCE = Path(__file__)

Surface = tuple[Array, Index]
"""Vertices in voxels (n, 3), and triangles (m, 3)."""


def organs(labels: Volume, names: Mapping[int, str], parts: Sequence[SurfacePart], *, most: int) -> list[Mesh]:
    """Return the surface of each part that occurs in a label map, of at most so many vertices.

    Surfaces come from the cache folder where they were made before: making them takes libraries whose
    import alone takes longer than the first picture may.
    """
    chosen = [[n for n, name in names.items() if any(fnmatchcase(name, p) for p in part.tissues)] for part in parts]
    file = _kept_file(labels.voxels, chosen, most)
    found = recall(file, _read, "surfaces of organs")
    if found is None:
        found = [_surface(np.isin(labels.voxels, numbers), most) for numbers in chosen]
        keep(file, lambda stream: _write(stream, found), "surfaces of organs")
    return [
        Mesh(
            name=part.name, kind="surface", colour=part.colour, opacity=part.opacity,
            points=labels.position(points), indices=triangles,
        )
        for part, (points, triangles) in zip(parts, found, strict=True)
        if len(points)
    ]  # fmt: skip


def _kept_file(voxels: NDArray[np.integer], chosen: list[list[int]], most: int) -> Path | None:
    """A name that changes with the labels and with this file."""
    held = np.ascontiguousarray(voxels)
    return place(f"surfaces-{digest(held.shape, held.dtype, held.tobytes(), chosen, most, _SOURCE.read_bytes())}.npz")


def _write(stream: IO[bytes], found: list[Surface]) -> None:
    np.savez(stream, *(array for surface in found for array in surface))


def _read(stream: IO[bytes]) -> list[Surface]:
    with np.load(stream, allow_pickle=False) as kept:
        arrays = [kept[f"arr_{k}"] for k in range(len(kept.files))]
    return list(zip(arrays[::2], arrays[1::2], strict=True))


def _surface(inside: NDArray[np.bool_], most: int) -> Surface:
    """The surface of a mask; empty where it holds nothing."""
    if not inside.any():
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint32)
    window, first = _window(inside)
    points, triangles = _contour(_soft(window), most)
    return points + first, triangles


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

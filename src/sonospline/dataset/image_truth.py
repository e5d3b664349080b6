"""What is true at each pixel of an image: which tissue lies there now, how it came there, and where the needle is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry import pose
from ..geometry.needle import Needle
from ..geometry.plane import ImagePlane
from ..geometry.volume import Volume
from ..ultrasound.probe import Probe
from .draws import Array

Single = NDArray[np.float32]


def displacement_now(field: GridField, plane: ImagePlane, stride: int) -> Array:
    """Return how the tissue that is now at places of an image came there, along its axes.

    Parameters
    ----------
    field : GridField
        The deformation.
    plane : ImagePlane
        The pixels.
    stride : int
        Pixels between the places: the middles of blocks of so many pixels each way.

    Returns
    -------
    (rows / stride, columns / stride, 3) ndarray
        Right, down and away from the viewer, mm; NaN where the inverse map was not found.
    """
    rows, columns = (n // stride for n in plane.shape)
    at = [(np.arange(n) + 0.5) * stride - 0.5 for n in (columns, rows)]
    x, y = np.meshgrid(at[0] * plane.spacing_mm[0], at[1] * plane.spacing_mm[1])
    flat = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    places = pose.to_reference(plane.image_to_reference, flat)
    moved = (places - field.inverse(places)) @ plane.image_to_reference[:3, :3]
    return moved.reshape(rows, columns, 3)


def labels_now(labels: Volume, numbers: NDArray[np.uint8], moved: Array, plane: ImagePlane) -> NDArray[np.uint8]:
    """Return the number of the tissue at each pixel.

    Parameters
    ----------
    labels : Volume
        Undeformed tissue; beyond it label 0 goes on.
    numbers : (256,) ndarray
        What each label is called in the image.
    moved : (m, n, 3) ndarray
        Of :func:`displacement_now`, of whatever stride.
    plane : ImagePlane
        The pixels.
    """
    rows, columns = plane.shape
    fine = _between(_between(moved, rows, axis=0), columns, axis=1)
    x = plane.spacing_mm[0] * np.arange(columns, dtype=np.float32) - fine[..., 0]
    y = plane.spacing_mm[1] * np.arange(rows, dtype=np.float32)[:, None] - fine[..., 1]
    z = -fine[..., 2]
    lattice, to_world = labels.lattice, plane.image_to_reference
    turn = (lattice.direction.T @ to_world[:3, :3]) / np.array(lattice.spacing)[:, None]
    start = labels.index(to_world[:3, 3][None])[0]
    flat, inside = np.zeros(plane.shape), np.ones(plane.shape, bool)
    for along, first, count in zip(turn.astype(np.float32), start.astype(np.float32), lattice.shape, strict=True):
        index = np.rint(along[0] * x + along[1] * y + along[2] * z + first)
        inside &= (index >= 0) & (index < count)  # which what is not known is not
        flat *= count
        flat += index
    at = np.where(inside, flat, 0).astype(np.intp)
    return np.where(inside, numbers[labels.voxels.reshape(-1)[at]], numbers[0])


def needle_pixels(needle: Needle, diameter_mm: float, probe: Probe, plane: ImagePlane) -> NDArray[np.bool_]:
    """Return the pixels of a needle's shaft, as far as it is within the slice: half as high there as in its middle."""
    ends = plane.project(np.stack([needle.entry, needle.tip]))
    t = np.linspace(0.0, 1.0, 2 + int(8 * needle.depth / min(plane.spacing_mm)))
    axis = ends[0] + t[:, None] * (ends[1] - ends[0])
    depth = np.clip(axis[:, 1], 0, probe.depth_mm)
    seen = np.abs(axis[:, 2]) <= np.sqrt(2 * np.log(2)) * probe.elevation_sigma(depth) + diameter_mm / 2
    mask = np.zeros(plane.shape, bool)
    if not seen.any():
        return mask
    first, last = axis[seen][0, :2], axis[seen][-1, :2]
    along = last - first
    length = float(np.hypot(*along))
    along = along / length if length else np.zeros(2)
    x, y = (axis - start for axis, start in zip(plane.axes_mm, first, strict=True))
    at = np.clip(x * along[0] + y * along[1], 0, length)
    reach = max(diameter_mm / 2, min(plane.spacing_mm) / 2)
    return (x - at * along[0]) ** 2 + (y - at * along[1]) ** 2 <= reach**2


def _between(values: NDArray[np.floating], count: int, *, axis: int) -> Single:
    """Values in the middles of equal blocks at every place of an axis: linear between, and on beyond the last."""
    held = values.shape[axis]
    single = values.astype(np.float32)
    if held == count:
        return single
    place = (np.arange(count) + 0.5) * held / count - 0.5
    low = np.clip(np.floor(place).astype(int), 0, max(held - 2, 0))
    weight = (place - low).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(3)])
    start, end = np.take(single, low, axis), np.take(single, np.minimum(low + 1, held - 1), axis)
    return start + weight * (end - start)

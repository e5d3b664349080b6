"""NumPy twin of the core's surfaces where the acoustic impedance steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Found = tuple[Array, ...]

_BORDER = 6
"""Voxels on either side that smoothing and slopes look at."""
_SLAB = 48
"""Planes of voxels at once."""


def find_interfaces(
    labels: NDArray[np.uint8],
    spacing: Array,
    impedance: Array,
    smoothing: float,
    smallest: float,
    largest: float,
    points_per_mm2: float,
) -> Found:
    """Return points (m, 3) in mm from the first voxel, unit normals (m, 3), reflection (m,) and area (m,).

    Some points per voxel face between labels of different impedance, off its middle by a hash of their place,
    then moved along the normal onto the step of the smoothed impedance: voxel faces themselves would
    ring like stairs.
    """
    from scipy.ndimage import gaussian_filter

    copies = interface_copies(spacing, points_per_mm2)
    found = []
    for first in range(0, len(labels), _SLAB):
        start, stop = max(0, first - _BORDER), min(len(labels), first + _SLAB + _BORDER)
        part = labels[start:stop]
        smooth = gaussian_filter(impedance.astype(np.float32)[part], smoothing * spacing.min() / spacing)
        own = slice(first - start, first - start + _SLAB)
        for axis in range(3):
            found.append(_faces(part, smooth, impedance, spacing, axis, start, own, copies, smallest, largest))
    points, normals, reflection, area = (np.concatenate(kind) for kind in zip(*found, strict=True))
    return points, normals, reflection, area


def largest_face(spacing: Array) -> float:
    """Return the largest face of a voxel, mm^2."""
    return float(np.prod(spacing) / spacing.min())


def interface_copies(spacing: Array, points_per_mm2: float) -> int:
    """Return how many points a face between voxels gets, one after the other."""
    return max(1, round(points_per_mm2 * largest_face(spacing)))


def _faces(
    labels: NDArray[np.uint8],
    smooth: Floats,
    impedance: Array,
    spacing: Array,
    axis: int,
    start: int,
    own: slice,
    copies: int,
    smallest: float,
    largest: float,
) -> Found:
    """Points on the faces across one axis whose first voxel lies in planes ``own`` of a slab."""
    low, high = (labels[tuple(s if a == axis else slice(None) for a in range(3))] for s in (slice(-1), slice(1, None)))
    index = np.argwhere(low[own] != high[own])
    index[:, 0] += own.start
    z1, z2 = impedance[low[tuple(index.T)]], impedance[high[tuple(index.T)]]
    step = np.abs(z2 - z1) / (z2 + z1)
    kept = step > smallest
    face = np.prod(spacing) / spacing[axis]
    middle = np.repeat(((z1 + z2) / 2)[kept], copies)
    index, step = np.repeat(index[kept], copies, axis=0), np.repeat(step[kept], copies)
    beside = index.copy()
    beside[:, axis] += 1
    before, after = (smooth[tuple(side.T)].astype(np.float64) for side in (index, beside))
    normal = np.empty((len(index), 3))
    last = np.array(labels.shape) - 1
    for a in range(3):
        if a == axis:
            normal[:, a] = (after - before) / spacing[a]
            continue
        ahead, behind = (np.clip(index[:, a] + s, 0, last[a]) for s in (1, -1))
        total = np.zeros(len(index))
        for side in (index, beside):
            total += smooth[tuple(ahead if b == a else side[:, b] for b in range(3))]
            total -= smooth[tuple(behind if b == a else side[:, b] for b in range(3))]
        normal[:, a] = total / (4 * spacing[a])
    slope = np.linalg.norm(normal, axis=1) + 1e-12
    normal /= slope[:, None]
    shift = np.clip((middle - (before + after) / 2) / slope, -spacing.min(), spacing.min())
    index[:, 0] += start
    offset = _scattered(index, axis, copies) * spacing
    offset[:, axis] = 0
    along = (offset * normal).sum(axis=1)
    points = index * spacing + offset + (shift - along)[:, None] * normal
    points[:, axis] += 0.5 * spacing[axis]
    return points, normal, np.minimum(step, largest), face / copies * np.abs(normal[:, axis])


def _scattered(index: NDArray[np.int64], axis: int, copies: int) -> Array:
    """Offsets (m, 3) in voxels of the points of a face, by a hash of its place."""
    number = index.astype(np.uint64) @ np.array([1 << 28, 1 << 14, 1], np.uint64)
    copy = np.tile(np.arange(copies), len(index) // copies).astype(np.uint64)
    key = ((number * np.uint64(3) + np.uint64(axis)) * np.uint64(64) + copy) * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return np.stack([(key >> np.uint64(8 + 16 * a)) & np.uint64(0xFFFF) for a in range(3)], axis=1) / 65536.0 - 0.5

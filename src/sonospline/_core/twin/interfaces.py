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
    """Return points (m, 3) in mm, unit normals (m, 3), reflection and area (m,), labels (m, 2) and a random sign (m,).

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
    return tuple(np.concatenate(kind) for kind in zip(*found, strict=True))


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
    parted = np.stack([low[tuple(index.T)], high[tuple(index.T)]], axis=1)
    z1, z2 = impedance[parted].T
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
    key = _hashed(index, axis, copies)
    bits = [(key >> np.uint64(8 + 16 * a)) & np.uint64(0xFFFF) for a in range(3)]
    offset = (np.stack(bits, axis=1) / 65536.0 - 0.5) * spacing
    offset[:, axis] = 0
    along = (offset * normal).sum(axis=1)
    points = index * spacing + offset + (shift - along)[:, None] * normal
    points[:, axis] += 0.5 * spacing[axis]
    sign = np.where(key >> np.uint64(63), 1.0, -1.0)
    area = face / copies * np.abs(normal[:, axis])
    return points, normal, np.minimum(step, largest), area, np.repeat(parted[kept], copies, axis=0), sign


def _hashed(index: NDArray[np.int64], axis: int, copies: int) -> NDArray[np.uint64]:
    """Hashes (m,) of the points of faces: of offsets within the face, and of signs."""
    number = index.astype(np.uint64) @ np.array([1 << 28, 1 << 14, 1], np.uint64)
    copy = np.tile(np.arange(copies), len(index) // copies).astype(np.uint64)
    key = ((number * np.uint64(3) + np.uint64(axis)) * np.uint64(64) + copy) * np.uint64(0x9E3779B97F4A7C15)
    return (key ^ (key >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)

"""Surfaces where the acoustic impedance steps, as points that move with the tissue."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..grid import Grid

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Window = tuple[slice, slice, slice]

_SMOOTHING_VOXELS = 1.2
_SMALLEST_STEP = 0.004
"""Reflection coefficient below which a surface is not seen."""
_LARGEST_STEP = 0.5
"""Bone and gas reflect more; beyond this, brightness says nothing new."""
_BORDER = 6
POINTS_PER_MM2 = 6.0


class Interfaces(NamedTuple):
    """Points on surfaces."""

    points: Floats
    """(m, 3) world positions."""
    normals: Floats
    """(m, 3) unit normals."""
    reflection: Floats
    """(m,) |R| = |Z2 - Z1| / (Z2 + Z1), at most 0.5."""
    area: Floats
    """(m,) surface each point stands for, mm^2."""


def find_interfaces(labels: NDArray[np.uint8], lattice: Grid, impedance: Array, window: Window) -> Interfaces:
    """Return points on the surfaces of a label map within a window of voxels.

    Some points per voxel face between labels of different impedance, off its middle by a hash of their place,
    then moved along the normal onto the step of the smoothed impedance: voxel faces themselves would
    ring like stairs.
    """
    from scipy.ndimage import gaussian_filter

    spacing = np.array(lattice.spacing)
    wider = tuple(
        slice(max(0, w.start - _BORDER), min(n, w.stop + _BORDER)) for w, n in zip(window, labels.shape, strict=True)
    )
    part = labels[wider]
    smooth = gaussian_filter(impedance.astype(np.float32)[part], _SMOOTHING_VOXELS * spacing.min() / spacing)
    start = np.array([w.start for w in wider])
    found = [_faces(part, smooth, impedance, spacing, axis, start) for axis in range(3)]
    points, normals, reflection, area = (np.concatenate(kind) for kind in zip(*found, strict=True))
    index = points / spacing + start
    kept = np.logical_and.reduce([(index[:, a] >= w.start) & (index[:, a] < w.stop) for a, w in enumerate(window)])
    return Interfaces(
        lattice.world(index[kept] * spacing).astype(np.float32),
        (normals[kept] @ lattice.direction.T).astype(np.float32),
        reflection[kept].astype(np.float32),
        area[kept].astype(np.float32),
    )


def _faces(
    labels: NDArray[np.uint8], smooth: Floats, impedance: Array, spacing: Array, axis: int, place: NDArray[np.int64]
) -> tuple[Array, ...]:
    """Points (mm from the window's first voxel), normals, reflection and area of the faces across one axis."""
    low, high = (labels[tuple(s if a == axis else slice(None) for a in range(3))] for s in (slice(-1), slice(1, None)))
    index = np.argwhere(low != high)
    z1, z2 = impedance[low[tuple(index.T)]], impedance[high[tuple(index.T)]]
    step = np.abs(z2 - z1) / (z2 + z1)
    kept = step > _SMALLEST_STEP
    face = np.prod(spacing) / spacing[axis]
    copies = max(1, round(POINTS_PER_MM2 * face))
    middle = np.repeat(((z1 + z2) / 2)[kept], copies)
    index, step = np.repeat(index[kept], copies, axis=0), np.repeat(step[kept], copies)
    beside = index.copy()
    beside[:, axis] += 1
    before, after = smooth[tuple(index.T)], smooth[tuple(beside.T)]
    gradient = np.empty((len(index), 3))
    last = np.array(labels.shape) - 1
    for a in range(3):
        if a == axis:
            gradient[:, a] = (after - before) / spacing[a]
            continue
        ahead, behind = (np.clip(index[:, a] + s, 0, last[a]) for s in (1, -1))
        total = np.zeros(len(index))
        for side in (index, beside):
            total += smooth[tuple(ahead if b == a else side[:, b] for b in range(3))]
            total -= smooth[tuple(behind if b == a else side[:, b] for b in range(3))]
        gradient[:, a] = total / (4 * spacing[a])
    slope = np.linalg.norm(gradient, axis=1) + 1e-12
    normal = gradient / slope[:, None]
    shift = np.clip((middle - (before + after) / 2) / slope, -spacing.min(), spacing.min())
    number = (place + index).astype(np.uint64) @ np.array([1 << 28, 1 << 14, 1], np.uint64)
    number = (number * np.uint64(3) + np.uint64(axis)) * np.uint64(64) + np.tile(
        np.arange(copies), len(index) // copies
    ).astype(np.uint64)
    key = number * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    offset = np.stack([(key >> np.uint64(8 + 16 * a)) & np.uint64(0xFFFF) for a in range(3)], axis=1) / 65536.0 - 0.5
    offset[:, axis] = 0.5
    tangent = offset * spacing
    tangent[:, axis] = 0
    tangent -= (tangent * normal).sum(axis=1, keepdims=True) * normal
    points = index * spacing + shift[:, None] * normal + tangent
    points[:, axis] += 0.5 * spacing[axis]
    area = face / copies * np.abs(normal[:, axis])
    return points, normal, np.minimum(step, _LARGEST_STEP), area

"""Surfaces where the acoustic impedance steps, as points that move with the tissue."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..grid import Grid

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_SMOOTHING_VOXELS = 1.2
_SMALLEST_STEP = 0.004
"""Reflection coefficient below which a surface is not seen."""
_LARGEST_STEP = 0.5
"""Bone and gas reflect more; beyond this, brightness says nothing new."""


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


def find_interfaces(labels: NDArray[np.uint8], lattice: Grid, impedance: Array, seed: int = 0) -> Interfaces:
    """Return points on the surfaces of a label map.

    One point per voxel face between labels of different impedance, moved along the normal onto the
    step of the smoothed impedance: voxel faces themselves would ring like stairs.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates

    spacing = np.array(lattice.spacing)
    faces, steps, reflection = [], [], []
    for axis in range(3):
        low, high = (labels[tuple(s if a == axis else slice(None) for a in range(3))] for s in (slice(-1), slice(1, None)))
        index = np.argwhere(low != high)
        z1, z2 = impedance[low[tuple(index.T)]], impedance[high[tuple(index.T)]]
        step = np.abs(z2 - z1) / (z2 + z1)
        kept = step > _SMALLEST_STEP
        middle = index[kept].astype(np.float32)
        middle[:, axis] += 0.5
        faces.append(middle)
        steps.append(((z1 + z2) / 2)[kept])
        reflection.append(np.column_stack([step[kept], np.full(kept.sum(), axis)]))
    at, middle_z = np.concatenate(faces), np.concatenate(steps)
    size, axis = np.concatenate(reflection).T
    if not len(at):
        return Interfaces(*(np.zeros(s, np.float32) for s in ((0, 3), (0, 3), 0, 0)))
    random = np.random.default_rng(seed)
    smooth = gaussian_filter(impedance.astype(np.float32)[labels], _SMOOTHING_VOXELS / spacing * spacing.min())
    spread = random.uniform(-0.5, 0.5, at.shape).astype(np.float32)
    spread[np.arange(len(at)), axis.astype(int)] = 0  # along the face: no lattice of points
    at = at + spread

    def sampled(index: Floats) -> Floats:
        return map_coordinates(smooth, index.T, order=1, mode="nearest")

    gradient = np.empty_like(at)
    for a in range(3):
        offset = np.zeros(3, np.float32)
        offset[a] = 1
        gradient[:, a] = (sampled(at + offset) - sampled(at - offset)) / (2 * spacing[a])
    slope = np.linalg.norm(gradient, axis=1) + 1e-12
    normal = gradient / slope[:, None]
    shift = np.clip((middle_z - sampled(at)) / slope, -spacing.min(), spacing.min())
    local = at * spacing + shift[:, None] * normal
    facing = np.abs(normal[np.arange(len(at)), axis.astype(int)])
    area = np.prod(spacing) / spacing[axis.astype(int)] * facing
    return Interfaces(
        lattice.world(local).astype(np.float32),
        (normal @ lattice.direction.T).astype(np.float32),
        np.minimum(size, _LARGEST_STEP).astype(np.float32),
        area.astype(np.float32),
    )

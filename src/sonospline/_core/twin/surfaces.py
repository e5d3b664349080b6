"""NumPy twin of what surfaces echo: walls of two layers, what roughness scatters, and normals that turn."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


class Points(NamedTuple):
    """Points on surfaces: places and normals (m, 3), reflection and area (m,), labels (m, 2), random signs (m,)."""

    points: NDArray[Any]
    normals: NDArray[Any]
    reflection: NDArray[Any]
    area: NDArray[Any]
    labels: NDArray[Any]
    sign: NDArray[Any]


def layered(found: Points, impedance: Array, wall_mm: Array, wall: float, largest: float) -> Points:
    """Return points with those around fluids twice: where the fluid ends, and where its wall does."""
    thickness = wall_mm[found.labels]
    fluid = np.where(thickness[:, 0] >= thickness[:, 1], 0, 1)
    every = np.arange(len(fluid))
    z_fluid, beyond = impedance[found.labels[every, fluid]], impedance[found.labels[every, 1 - fluid]]
    walled = np.flatnonzero((thickness.max(axis=1) > 0) & (beyond != wall))
    inner, outer = (np.minimum(np.abs(wall - z) / (wall + z), largest)[walled] for z in (z_fluid, beyond))
    reflection = found.reflection.astype(np.float64)
    reflection[walled] = inner
    outwards = np.where(z_fluid < beyond, 1, -1) * thickness.max(axis=1)
    further = found.points.astype(np.float64) + outwards[:, None] * found.normals
    second = Points(*(part[walled] for part in found))._replace(points=further[walled], reflection=outer)
    first = found._replace(points=found.points.astype(np.float64), reflection=reflection)
    # in the core's order: the second layer of a point follows its first
    order = np.argsort(np.concatenate([every, walled + 0.5]), kind="stable")
    return Points(*(np.concatenate(pair)[order] for pair in zip(first, second, strict=True)))


def scattered(found: Points, rough: Array, beam_mm2: Array) -> Array:
    """Return what points scatter over what they mirror: random signs, whose sum in a beam stands ``rough`` below."""
    area = np.maximum(found.area.astype(np.float64), 1e-9)
    share: Array = found.sign * rough[found.labels].max(axis=1) * 2 * np.sqrt(np.pi * beam_mm2 / area)
    return share


def reflected(
    slopes: tuple[Floats, Floats, Floats], beam: Floats, surfaces: Floats, width: float, step: float
) -> NDArray[np.floating]:
    """Return amplitudes (m,) of surfaces where the tissue has turned their normals, in whole steps.

    ``slopes`` (3, m) each are the place's along the cell's three edges, ``beam`` (3, m) points along the beam.
    """
    u, v, w = slopes
    n = sum(np.cross(a, b, axis=0) * part for a, b, part in zip((v, w, u), (w, u, v), surfaces[:3], strict=True))
    assert not isinstance(n, int)
    squared = (n * n).sum(axis=0) + np.float32(1e-20)
    along = (n * beam).sum(axis=0) ** 2 / (squared * (beam * beam).sum(axis=0))
    size = surfaces[3] * np.exp(-np.clip(np.float32(width) * (1 - along), 0, 9)) + surfaces[4]
    return np.rint(np.clip(size / np.float32(step), -32767, 32767)) * np.float32(step)

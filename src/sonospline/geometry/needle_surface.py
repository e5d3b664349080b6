"""A needle to look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STEEL = "#d0d4d8"
_SIDES, _RADIUS_MM, _POINT_MM = 12, 0.6, 2.0


def needle_surface(length_mm: float) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Return points (n, 3) and triangles (m, 3) of a shaft with its pointed tip at the origin, behind it along -z."""
    turn = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = _RADIUS_MM * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_SIDES)])
    points: NDArray[np.float64] = np.vstack(
        [ring - (0, 0, _POINT_MM), ring - (0, 0, length_mm), (0, 0, 0), (0, 0, -length_mm)]
    )
    a = np.arange(_SIDES)
    b, n, m = (a + 1) % _SIDES, _SIDES, 2 * _SIDES
    sides = [(a + n, b, a), (a + n, b + n, b), (a, b, np.full(n, m)), (b + n, a + n, np.full(n, m + 1))]
    triangles: NDArray[np.int64] = np.vstack([np.column_stack(each) for each in sides])
    return points, triangles

"""Painting shapes into a label map, each within its bounding box."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._memory import refuse_beyond
from .._shown import lengths

Array = NDArray[np.floating]

_BYTES_EACH = 3
"""Of a voxel, while it is painted."""
_MORE_THAN_ANY = 1e15
"""Voxels, beyond what any memory holds."""
_PLANES = 16
"""Painted at once by a thread: few enough for the cache, enough to be worth waking it."""


class Canvas:
    """A label map on a lattice along the world axes.

    Parameters
    ----------
    low_mm, high_mm : (float, float, float)
        Its first and last corner.
    spacing_mm : float
        Voxel size.

    Raises
    ------
    ValueError
        More voxels than memory holds.
    """

    def __init__(self, low_mm: ArrayLike, high_mm: ArrayLike, spacing_mm: float) -> None:
        self.origin = np.asarray(low_mm, float)
        self.spacing_mm = spacing_mm
        size = np.asarray(high_mm, float) - self.origin
        with np.errstate(over="ignore"):
            counts = np.rint(size / spacing_mm) + 1
            voxels = int(min(counts.prod(), _MORE_THAN_ANY))
        what = f"a phantom of {lengths(size)} at spacing_mm = {spacing_mm:g}"
        refuse_beyond(_BYTES_EACH * voxels, what, remedy="use larger voxels, or a smaller scene")
        self.labels = np.zeros(counts.astype(int), np.uint8)

    def axes(self, window: tuple[slice, ...] | None = None) -> tuple[Array, Array, Array]:
        """Return coordinates of the voxels of a window in mm, to be broadcast against each other."""
        chosen = window or (slice(None),) * 3
        x, y, z = (
            (np.float32(o) + self.spacing_mm * np.arange(n, dtype=np.float32))[s]
            for o, n, s in zip(self.origin, self.labels.shape, chosen, strict=True)
        )
        return x[:, None, None], y[None, :, None], z[None, None, :]

    def window(self, low: ArrayLike, high: ArrayLike) -> tuple[slice, ...]:
        """Return the voxels of a box in mm."""
        first = np.floor((np.asarray(low, float) - self.origin) / self.spacing_mm).astype(int)
        last = np.ceil((np.asarray(high, float) - self.origin) / self.spacing_mm).astype(int) + 1
        return tuple(
            slice(max(0, a), max(0, min(n, b))) for a, b, n in zip(first, last, self.labels.shape, strict=True)
        )

    def paint(
        self,
        label: int,
        low: ArrayLike,
        high: ArrayLike,
        inside: Callable[[Array, Array, Array], NDArray[np.bool_]],
        *,
        over: tuple[int, ...] | None = None,
    ) -> None:
        """Give a label to the voxels of a box that lie inside a shape (and hold one of ``over``)."""
        x, *rest = self.window(low, high)

        def paint(first: int) -> None:
            window = (slice(first, min(first + _PLANES, x.stop)), *rest)
            part = self.labels[window]
            if not part.size:
                return
            chosen = np.broadcast_to(inside(*self.axes(window)), part.shape)
            if over is not None:
                chosen = chosen & _any_of(over)[part]
            part[chosen] = label

        for _ in _painters().map(paint, range(x.start, x.stop, _PLANES)):
            pass

    def tube(
        self,
        label: int,
        start: ArrayLike,
        end: ArrayLike,
        radii: tuple[float, float],
        *,
        over: tuple[int, ...] | None = None,
    ) -> None:
        """Paint a tube with round ends, its radius going from one value to the other."""
        a, b = np.asarray(start, float), np.asarray(end, float)
        reach = max(radii)
        along = (b - a) / max(float((b - a) @ (b - a)), 1e-9)

        def inside(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
            t = np.clip((x - a[0]) * along[0] + (y - a[1]) * along[1] + (z - a[2]) * along[2], 0, 1)
            foot = [a[i] + t * (b[i] - a[i]) for i in range(3)]
            radius = radii[0] + t * (radii[1] - radii[0])
            return (x - foot[0]) ** 2 + (y - foot[1]) ** 2 + (z - foot[2]) ** 2 < radius**2

        self.paint(label, np.minimum(a, b) - reach, np.maximum(a, b) + reach, inside, over=over)


def _any_of(labels: tuple[int, ...]) -> NDArray[np.bool_]:
    chosen = np.zeros(256, bool)
    chosen[list(labels)] = True
    return chosen


@lru_cache(maxsize=1)
def _painters() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), "sonospline-canvas")

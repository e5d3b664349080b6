"""Which voxels a straight line passes, exactly: the pieces between the faces that it crosses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .needle import Needle
from .volume import Volume

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_ROUNDING = 1e-6
"""Voxels: from a face within which a line runs in the face itself, and of the shortest piece."""


class Pieces(NamedTuple):
    """The pieces of a line, each in one voxel, or in the face or edge that some share."""

    places: Array
    """(n + 1,) along the line from its start, mm: where pieces begin, and the end of the last."""
    first: Index
    """(n, 3) the voxel of each piece; where several share it, the one of lowest indices. Some lie beyond the image."""
    last: Index
    """(n, 3) the one of highest indices."""

    def __repr__(self) -> str:
        return f"Pieces({len(self.first)} of {self.places[-1]:.4g} mm)"


def voxels_along(volume: Volume, needle: Needle) -> Pieces:
    """Return the voxels of an image along a needle, from its entry to its tip.

    Examples
    --------
    >>> import numpy as np
    >>> import sonospline as ss
    >>> from sonospline.geometry.voxels_along import voxels_along
    >>> from sonospline.geometry.volume import Volume
    >>> volume = Volume(voxels=np.zeros((4, 4, 4)), spacing=2)
    >>> pieces = voxels_along(volume, ss.Needle(entry=(0, 2, 2), tip=(5, 2, 2)))
    >>> pieces.places.tolist(), pieces.first[:, 0].tolist()
    ([0.0, 1.0, 3.0, 5.0], [0, 1, 2])
    """
    start, end = volume.index(np.stack([needle.entry, needle.tip]))
    way = end - start
    shares = [np.array([0.0, 1.0])]
    for first, step, count in zip(start, way, volume.voxels.shape, strict=True):
        if abs(step) > _ROUNDING:
            low, high = sorted((first, first + step))
            faces = np.arange(max(0, np.ceil(low + 0.5)), min(count, np.floor(high + 0.5)) + 1) - 0.5
            shares.append((faces - first) / step)
    crossed = np.sort(np.clip(np.concatenate(shares), 0.0, 1.0))
    crossed = crossed[np.append(True, np.diff(crossed) > _ROUNDING / np.linalg.norm(way))]
    middles = start + 0.5 * (crossed[1:] + crossed[:-1])[:, None] * way
    # in a face both voxels count, on an edge four: rounding alone must not choose
    first, last = np.ceil(middles - 0.5 - _ROUNDING), np.floor(middles + 0.5 + _ROUNDING)
    return Pieces(crossed * needle.depth, first.astype(np.intp), last.astype(np.intp))

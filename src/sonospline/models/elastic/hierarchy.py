"""Coarser and coarser grids over the same box, and the inverse on the coarsest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..._core.hexahedra import Level, free_nodes, stiffness
from ...geometry.grid import FACES
from ...geometry.tissue import Tissue
from ...mechanics.moduli import Moduli

Array = NDArray[np.float64]

_DENSE = 800
"""Unknowns up to which a level is inverted."""
_EVEN = 1.5
"""An axis is halved while its cells are at most so much longer than the shortest."""


def pinned_faces(tissue: Tissue) -> list[bool]:
    """Return which of the faces, in the order of ``FACES``, do not move."""
    return [face in tissue.pinned_faces for face in FACES]


def levels(moduli: Moduli, tissue: Tissue) -> list[Level]:
    """Return spacing and moduli of each level, the finest first; coarse moduli are means of their children."""
    pinned = pinned_faces(tissue)
    spacing = np.array(moduli.grid.spacing)
    lame, shear = moduli.lame, moduli.shear
    found = [_level(spacing, lame, shear)]
    while 3 * free_nodes(lame.shape, pinned).sum() > _DENSE:
        cells = np.array(lame.shape)
        halved = (cells >= 4) & (spacing <= _EVEN * spacing[cells >= 4].min(initial=np.inf))
        if not halved.any():
            break
        coarse = np.where(halved, -(-cells // 2), cells)
        spacing = spacing * cells / coarse
        lame, shear = (_mean_of_children(values, coarse) for values in (lame, shear))
        found.append(_level(spacing, lame, shear))
    return found


def coarse_inverse(level: Level, tissue: Tissue, full: bool) -> NDArray[np.float32]:
    """Return the inverse of a level's operator over its free unknowns; (0, 0) where it is too large."""
    from scipy.linalg.lapack import dpotrf, dpotri

    free = np.tile(free_nodes(level[1].shape, pinned_faces(tissue)).ravel(), 3)
    if free.sum() > 2 * _DENSE:
        return np.zeros((0, 0), np.float32)
    factor, failed = dpotrf(stiffness(level, full)[free][:, free].toarray(order="F"), lower=True, overwrite_a=True)
    if failed:  # moduli are above zero and a face is pinned, but double precision ends
        raise ValueError(
            f"shear moduli from {level[2].min():.3g} to {level[2].max():.3g} leave no solvable system; "
            "give stiffnesses in better proportion"
        )
    lower, _ = dpotri(factor, lower=True, overwrite_c=True)
    inverse = lower.astype(np.float32)
    return np.ascontiguousarray(np.tril(inverse) + np.tril(inverse, -1).T)


def _level(spacing: Array, lame: Array, shear: Array) -> Level:
    sides = float(spacing[0]), float(spacing[1]), float(spacing[2])
    return sides, np.ascontiguousarray(lame, np.float32), np.ascontiguousarray(shear, np.float32)


def _mean_of_children(values: Array, coarse: NDArray[np.int64]) -> Array:
    """Mean over each coarse cell, by volume where a fine cell lies across two."""
    for axis, (fine, count) in enumerate(zip(values.shape, coarse, strict=True)):
        if fine == 2 * count:
            lines = np.moveaxis(values, axis, 0)
            values = np.moveaxis((lines[::2] + lines[1::2]) / 2, 0, axis)
        elif fine != count:
            values = np.moveaxis(np.tensordot(_overlap(fine, int(count)), values, (1, axis)), 0, axis)
    return values


def _overlap(fine: int, coarse: int) -> Array:
    """Share (coarse, fine) of each coarse interval that each fine one covers."""
    edges = np.arange(coarse + 1) / coarse
    low, high = np.arange(fine) / fine, np.arange(1, fine + 1) / fine
    common = np.minimum(edges[1:, None], high) - np.maximum(edges[:-1, None], low)
    return np.maximum(common, 0.0) * coarse

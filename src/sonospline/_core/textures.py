"""How the level of speckle varies from place to place in a tissue: fixed to it, so that it moves along.

Each kind is a periodic volume of mean 0 and standard deviation 1, on voxels of a third of a correlation length.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._shown import shown

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

KINDS = ("blobs", "fibres", "strands", "triads")
"""Smooth ups and downs; thin bright sheets, close together; a wide net of them; bright-walled tubes, few and far."""

_VOXELS = 3.0
_SIDE = 56
_FIBRE, _STRAND = 0.3, 0.16
"""Half the width of a sheet, in standard deviations of the noise that it is a level of."""
_TUBES, _TUBE_LENGTH, _RADII, _WALL, _LUMEN = 48, 12.0, (0.9, 2.2), 0.45, 0.7
"""Portal triads: how many in a period, length and radii in voxels, thickness of wall and lumen over the radius."""


def texture_map(direction: ArrayLike, texture_mm: tuple[float, float, float]) -> Array:
    """Return what takes mm along a phantom's axes to voxels of a texture, (3, 3), whose first axis has a direction.

    Raises
    ------
    ValueError
        A direction that is not three finite numbers, or of length zero.
    """
    along = np.asarray(direction, float)
    if along.shape != (3,) or not np.isfinite(along).all():
        raise ValueError(f"texture_direction = {shown(direction)} is no direction; give three numbers")
    length = float(np.linalg.norm(along))
    if length == 0:
        raise ValueError("texture_direction = (0, 0, 0) has length zero; give the direction of the fibres")
    along = along / length
    up = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    up = up - (up @ along) * along
    up /= np.linalg.norm(up)
    axes: Array = np.stack([along, np.cross(up, along), up])
    return axes * (_VOXELS / np.array(texture_mm))[:, None]


@lru_cache(maxsize=len(KINDS))
def textures(kinds: int) -> Floats:
    """Return so many of the kinds, (kinds, side, side, side)."""
    return np.stack([make() for make in _MAKERS[:kinds]])


def _blobs() -> Floats:
    return _smooth(7, 1.3)


def _fibres() -> Floats:
    return _even(np.exp(-((_smooth(17, 1.3) / _FIBRE) ** 2)))


def _strands() -> Floats:
    return _even(np.exp(-((_smooth(27, 2.4) / _STRAND) ** 2)))


def _smooth(seed: int, sigma: float) -> Floats:
    """A periodic random volume, smooth over some voxels."""
    noise = np.random.default_rng(seed).standard_normal((_SIDE,) * 3).astype(np.float32)
    reach = int(4 * sigma + 0.5)
    offsets = range(-reach, reach + 1)
    weights = np.exp(-0.5 * (np.array(offsets) / sigma) ** 2)
    weights /= weights.sum()
    # as scipy.ndimage.gaussian_filter does, whose import takes ten times as long
    for axis in range(3):
        rolled = (weight * np.roll(noise, k, axis) for k, weight in zip(offsets, weights, strict=True))
        noise = sum(rolled, np.zeros(noise.shape)).astype(np.float32)
    return _even(noise)


def _tubes() -> Floats:
    """Short tubes at random, bright walls around a dark lumen."""
    random = np.random.default_rng(37)
    at = np.stack(np.meshgrid(*[np.arange(_SIDE, dtype=np.float32)] * 3, indexing="ij"), axis=-1)
    nearest = np.full((_SIDE,) * 3, np.inf, np.float32)  # over each tube's radius
    for _ in range(_TUBES):
        middle, along = (draw.astype(np.float32) for draw in (random.uniform(0, _SIDE, 3), random.standard_normal(3)))
        along /= np.linalg.norm(along)
        away = (at - middle + _SIDE / 2) % _SIDE - _SIDE / 2
        foot = np.clip(away @ along, -_TUBE_LENGTH / 2, _TUBE_LENGTH / 2)
        apart = np.linalg.norm(away - foot[..., None] * along, axis=-1) / np.float32(random.uniform(*_RADII))
        nearest = np.minimum(nearest, apart)
    wall, lumen = np.exp(-(((nearest - 1) / _WALL) ** 2)), np.exp(-((nearest / _LUMEN) ** 2))
    return _even(wall - 1.5 * lumen)


def _even(volume: NDArray[np.floating]) -> Floats:
    found: Floats = ((volume - volume.mean()) / volume.std()).astype(np.float32)
    return found


_MAKERS = (_blobs, _fibres, _strands, _tubes)

"""A phantom the package generates, for when no image is at hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .needle import Needle
from .volume import Volume

Array = NDArray[np.float64]

SPACING = 0.75
SHAPE = (128, 112, 112)
TARGET = np.array([62.0, 44.0, 42.0])

# Layers met along x (mm): where each ends and its mean echo, 0 to 1.
_LAYERS = ((4.0, 0.85), (16.0, 0.35), (18.0, 0.75), (34.0, 0.50), (36.0, 0.80), (np.inf, 0.42))
# Balls: centre, semi-axes (mm), mean echo.
_BODIES = (
    ((62.0, 42.0, 42.0), (24.0, 18.0, 20.0), 0.60),  # organ
    (TARGET, (5.0, 5.0, 5.0), 0.05),  # cyst: the target
    ((70.0, 58.0, 30.0), (4.0, 4.0, 4.0), 0.95),  # stone
    ((28.0, 24.0, 55.0), (40.0, 3.0, 3.0), 0.08),  # vessel, along x
)


def layered_block(seed: int = 0) -> Volume:
    """Return a block of layered, speckled tissue with an organ, a cyst, a stone and a vessel.

    About 95 x 83 x 83 mm at 0.75 mm, 8-bit; skin at x = 0. The same seed gives the same
    voxels.

    Examples
    --------
    >>> from sonospline.geometry.layered_block import layered_block
    >>> layered_block().voxels.shape
    (128, 112, 112)
    """
    from scipy.ndimage import gaussian_filter

    random = np.random.default_rng(seed)
    # Fully developed speckle: the envelope of a band-limited complex field.
    real, imaginary = (gaussian_filter(random.standard_normal(SHAPE), 0.8) for _ in range(2))
    envelope = np.hypot(real, imaginary)
    speckle = np.log1p(4 * envelope / envelope.mean()) / np.log(5)
    voxels = np.clip(255 * _echo() * speckle, 0, 255).astype(np.uint8)
    return Volume(voxels=voxels, spacing=(SPACING,) * 3)


def default_needle() -> Needle:
    """Return a needle path for :func:`layered_block`: from the skin to the cyst."""
    return Needle(np.array([0.0, 30.0, 42.0]), TARGET)


def _echo() -> Array:
    """Mean echo of each voxel."""
    x, y, z = (np.arange(n) * SPACING for n in SHAPE)
    ends, levels = zip(*_LAYERS, strict=True)
    # Interfaces undulate: flat layers would hide sideways motion.
    wave = 1.5 * np.sin(2 * np.pi * y[:, None] / 37) * np.cos(2 * np.pi * z / 51)
    depth = np.clip(x[:, None, None] + wave, 0, None)
    echo = np.array(levels)[np.searchsorted(ends, depth)]
    for centre, semi_axes, level in _BODIES:
        offsets = [((a - c) / s) ** 2 for a, c, s in zip((x, y, z), centre, semi_axes, strict=True)]
        inside = offsets[0][:, None, None] + offsets[1][:, None] + offsets[2] < 1
        echo[inside] = level
    return echo

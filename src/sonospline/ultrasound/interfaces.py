"""Surfaces where the acoustic impedance steps, as points that move with the tissue."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_SMOOTHING_VOXELS = 1.2
_SMALLEST_STEP = 0.004
"""Reflection coefficient below which a surface is not seen."""
_LARGEST_STEP = 0.5
"""Bone and gas reflect more; beyond this, brightness says nothing new."""
_POINTS_PER_MM2 = 6.0
_GAIN = 6.5
WIDTH = 7.0
"""Echo over speckle: R g exp(-7 sin^2 theta) for each of six points a mm^2."""
_FAINTEST = 0.02
NUMBERS = (_SMOOTHING_VOXELS, _SMALLEST_STEP, _LARGEST_STEP, _POINTS_PER_MM2, _GAIN, WIDTH, _FAINTEST)
"""As the core takes them."""


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

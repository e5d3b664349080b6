"""Scatterers in material coordinates: where they are, and how strongly they echo.

They fill bricks of tissue. A brick takes a prefix of one of a few shared Sobol patterns, mirrored, by a
hash of its position: the same tissue always holds the same scatterers. How long a prefix follows from the
brick's undeformed depth, so that a resolution cell holds as many near the probe as far from it. Sobol
order and independent random signs make 8 in a cell enough for fully developed speckle. Random places alone
would let intensities vary too much, even ones alone 7 % too little: one scatterer in ten goes astray.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core.textures import textures
from .acoustics import NO_ECHO, TISSUES
from .interfaces import NUMBERS

Array = NDArray[np.float64]

PER_BRICK = 48
"""Scatterers in a brick where they are densest."""
_PATTERNS = 64
_LONGEST = 512
_ASTRAY = 0.1
"""Share of scatterers at random places."""
_SOBOL_BITS = 24
_OPAQUE_DB = 8.0
"""dB/cm/MHz beyond which no beam comes back: of bone and gas."""


def echo_scene(labels: NDArray[np.uint8], spacing: tuple[float, float, float], table: Callable[[str], Array]) -> Any:
    """Return the core's phantom, which chooses scatterers: a label map and, by label, each property of its tissue."""
    places, signs = _patterns()
    opaque = (table("attenuation_db_cm_mhz") > _OPAQUE_DB).astype(float)
    rough, kinds = 10 ** (table("roughness_db") / 20), table("texture_kind")
    return _core.active.EchoScene(
        labels, spacing, table("impedance"), rough, table("wall_mm"), TISSUES["vessel wall"].impedance, opaque,
        table("backscatter_db"), table("texture_db"), kinds, table("texture_map"),
        textures(int(kinds.max()) + 1), places,
        signs, NUMBERS, NO_ECHO,
    )  # fmt: skip


@lru_cache(maxsize=1)
def _patterns() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Places in a unit brick (patterns, 3, n), in an order whose every prefix is even, and signs (patterns, n)."""
    random = np.random.default_rng(11)
    shifts = random.integers(0, 2**_SOBOL_BITS, (_PATTERNS, 1, 3), dtype=np.uint32)
    places = ((sobol(_LONGEST) ^ shifts) + 0.5) / 2**_SOBOL_BITS
    astray = random.random((_PATTERNS, _LONGEST)) < _ASTRAY
    places[astray] = random.random((int(astray.sum()), 3))
    along = np.ascontiguousarray(np.moveaxis(places, -1, 1), np.float32)
    return along, random.choice(np.array([-1, 1], np.float32), (_PATTERNS, _LONGEST))


def sobol(count: int) -> NDArray[np.uint32]:
    """Return the first points of the 3-D Sobol sequence, 24 bits (count, 3), by direction numbers of Joe and Kuo."""
    # SciPy has it in scipy.stats.qmc, whose import takes seconds
    points = np.zeros((count, 3), np.uint32)
    for axis, (start, coefficients) in enumerate((((1,), None), ((1,), ()), ((1, 3), (1,)))):
        directions = [m << (_SOBOL_BITS - 1 - k) for k, m in enumerate(start)]
        while len(directions) < _SOBOL_BITS:
            if coefficients is None:  # van der Corput's sequence
                directions.append(directions[-1] >> 1)
                continue
            degree = len(start)
            value = directions[-degree] ^ (directions[-degree] >> degree)
            for k, coefficient in enumerate(coefficients, start=1):
                value ^= coefficient * directions[-k]
            directions.append(value)
        for bit, direction in enumerate(directions[: count.bit_length()]):
            points[:, axis] ^= np.where(np.arange(count) >> bit & 1, direction, 0).astype(np.uint32)
    return points

"""A long step in time as parts that grow: short while what was just changed relaxes fast, long when little does."""

from __future__ import annotations

from math import ceil, log

import numpy as np
from numpy.typing import NDArray

FIRST, GROWTH = 0.5, 1.5
"""The first part, at most, over the shortest time constant; and each over the one before."""


def parts(dt: float, shortest_s: float) -> NDArray[np.float64]:
    """Return the ends of the parts of a step, as shares of it; one that is as short as a frame is a single part.

    Examples
    --------
    >>> from sonospline.elasticity.time_parts import parts
    >>> parts(1 / 60, 0.1).tolist(), (60 * parts(60.0, 0.1)).round(2).tolist()[:4], len(parts(60.0, 0.1))
    ([1.0], [0.05, 0.11, 0.22, 0.37], 16)
    """
    count = max(1, ceil(log(1 + (GROWTH - 1) * dt / (FIRST * shortest_s)) / log(GROWTH)))
    return np.asarray((GROWTH ** np.arange(1.0, count + 1) - 1) / (GROWTH**count - 1))

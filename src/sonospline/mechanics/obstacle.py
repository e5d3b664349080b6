"""Bone in a needle's way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._by_value import ByValue
from .._shown import place


@dataclass(frozen=True, eq=False, repr=False)
class Obstacle(ByValue):
    """Where a needle's line first enters rigid tissue.

    Parameters
    ----------
    label : int
        Of the tissue.
    name : str
        What the label map calls it; ``"label 7"`` where it has no name.
    depth_mm : float
        Along the needle, from its entry.
    point : (3,) ndarray
        Where that is in the world.
    """

    label: int
    name: str
    depth_mm: float
    point: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"Obstacle({self.name!r} at {self.depth_mm:.4g} mm, {place(self.point)})"

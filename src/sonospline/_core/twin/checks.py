"""What the twin refuses, in the words of the core."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

MOST_ALONG_AXIS, MOST_NODES = 1 << 24, (1 << 31) - 1


def require(met: bool | np.bool_, otherwise: str) -> None:
    if not met:
        raise ValueError(otherwise)


def require_spacing(spacing: Iterable[float]) -> None:
    lengths = np.array(tuple(spacing), float)
    require(bool(np.isfinite(lengths).all()) and lengths.min() > 0, "spacing is not three lengths above 0")


def numbered(shape: Iterable[int], fewest: int) -> bool:
    """Whether each axis has ``fewest`` entries or more, and 32 bits number all of them."""
    nodes = 1
    for n in shape:
        nodes *= n
        if not fewest <= n <= MOST_ALONG_AXIS or nodes > MOST_NODES:
            return False
    return True


def require_order(values: Any, order: int) -> None:
    """Whether a lattice has nodes enough for linear (1) or cubic (3) interpolation."""
    require(order in (1, 3), "order is neither 1 nor 3")
    fewest = 4 if order == 3 else 2
    require(min(values.shape[:3]) >= fewest, "values has fewer nodes along an axis than its order takes: 2, or 4")


def same_length(first: str, a: Any, second: str, b: Any) -> None:
    require(len(a) == len(b), f"{first} and {second} differ in length")

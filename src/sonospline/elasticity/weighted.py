"""Sums of displacements times their weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]


def weighted(parts: list[tuple[float, Single]]) -> Single:
    """Return the sum of fields, each times its weight, read-only; one pass over the numbers of each."""
    from scipy.linalg.blas import saxpy

    (weight, field), *others = parts
    total = field * np.float32(weight)
    for weight, field in others:
        saxpy(field.ravel(), total.ravel(), a=weight)
    total.setflags(write=False)
    return total

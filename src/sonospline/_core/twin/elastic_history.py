"""NumPy twin of the core's fields that follow another one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .checks import require

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def followed(fields: Single, start: Single, change: Single, forgotten: Array, taken_up: Array, nil: float) -> Single:
    """Return fields that follow another one, each at a pace of its own, after a step in time.

    Parameters
    ----------
    fields : (terms, 3, nx, ny, nz) ndarray of float32
        Before it.
    start, change : (3, nx, ny, nz) ndarray of float32
        What they follow: where it was, and by how much it changed.
    forgotten, taken_up : (terms,) ndarray
        Parts of each field's distance from ``start``, and of ``change``, that it makes good.
    nil : float
        Values smaller than that are 0: they would go on to numbers that are slow to compute with.
    """
    require(start.shape == fields.shape[1:], "start is not of the shape of the fields")
    require(change.shape == fields.shape[1:], "change is not of the shape of the fields")
    require(len(forgotten) == len(fields) == len(taken_up), "forgotten and taken_up are not of one number a field")
    near, far = (np.asarray(values, np.float32)[:, None, None, None, None] for values in (taken_up, forgotten))
    found = fields + far * (start - fields) + near * change
    found[np.abs(found) < nil] = 0
    return np.asarray(found)

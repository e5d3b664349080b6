"""What a cell is made of that holds several tissues: which of them mix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_CONTRAST_MIXED = 100.0
"""Tissues further apart in stiffness do not mix: beside bone a mean is neither bone nor soft."""


def mixing_shares(stiffness: Array, counted: NDArray[np.bool_] | None = None) -> Array:
    """Return the share of each sample (samples, cells) in what its cell is made of, of those that are counted.

    Samples are alike where no step between neighbours in order of stiffness is beyond a hundred
    times. Of several such groups that with the most samples takes the cell, of two equal ones the stiffer.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.mechanics.mixture import mixing_shares
    >>> mixing_shares(np.array([[1.0, 2.0], [30.0, 2.0], [5000.0, 900.0], [1.0, 900.0]])).T
    array([[0.33333333, 0.33333333, 0.        , 0.33333333],
           [0.        , 0.        , 0.5       , 0.5       ]])
    """
    order = np.argsort(stiffness, axis=0)
    ascending = np.take_along_axis(stiffness, order, axis=0)
    apart = ascending[1:] > LARGEST_CONTRAST_MIXED * ascending[:-1]
    group = np.zeros(stiffness.shape, np.int64)
    np.put_along_axis(group, order[1:], np.cumsum(apart, axis=0), axis=0)
    counted = np.ones(stiffness.shape, bool) if counted is None else counted
    sizes = np.stack([(counted & (group == number)).sum(axis=0) for number in range(int(group.max(initial=0)) + 1)])
    largest = len(sizes) - 1 - sizes[::-1].argmax(axis=0)
    taken = counted & (group == largest)
    return taken / np.maximum(taken.sum(axis=0), 1)

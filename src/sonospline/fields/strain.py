"""Whether a displacement is small enough for the linear theory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._shown import place
from .grid_field import GridField

Array = NDArray[np.float64]

SMALL = 0.1
"""Largest ``|grad u|`` at which small strain is a fair approximation: its error is of the order of the square."""


class Strain(NamedTuple):
    """The largest displacement gradient of a field."""

    largest: float
    """Frobenius norm of grad u."""
    place: Array
    """(3,) world position of it."""

    @property
    def small(self) -> bool:
        """Whether the linear theory holds there."""
        return self.largest <= SMALL

    def __repr__(self) -> str:
        return f"Strain({self.largest:.3g} at {place(self.place)})"


def largest_strain(field: GridField) -> Strain:
    """Return the largest gradient over the cells of a field's lattice, taken at their centres.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> from sonospline.fields import largest_strain
    >>> grid = ss.Grid.unit_cube(5)
    >>> stretched = ss.GridField(grid, 0.02 * grid.points.reshape(*grid.shape, 3))
    >>> round(largest_strain(stretched).largest, 4), largest_strain(stretched).small
    (0.0346, True)
    """
    lattice = field.grid if field.lattice is None else field.lattice
    slopes = [_slope(field.values, axis) / h for axis, h in enumerate(lattice.spacing)]
    squared = (np.stack(slopes) ** 2).sum(axis=(0, -1))
    cell = np.unravel_index(int(squared.argmax()), squared.shape)
    return Strain(float(np.sqrt(squared[cell])), lattice.node(np.array(cell) + 0.5))


def _slope(values: NDArray[np.floating], axis: int) -> NDArray[np.floating]:
    """Difference along one axis over each cell, the mean over the other two."""
    for a in range(3):
        low = values[(slice(None),) * a + (slice(None, -1),)]
        high = values[(slice(None),) * a + (slice(1, None),)]
        values = high - low if a == axis else (low + high) / 2
    return values

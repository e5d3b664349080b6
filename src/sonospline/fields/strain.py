"""Whether a displacement is small enough for the linear theory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._shown import place
from .grid_field import GridField

Array = NDArray[np.float64]

SMALL = 0.1
"""Largest ``|grad u|`` at which small strain is a fair approximation: 0.01 to 0.02 of the mean displacement."""

_GRADIENTS = np.array([0.0, 0.077, 0.153, 0.307, 0.460, 0.613, 0.920])
_MEAN = (
    np.array([0, 0.007, 0.014, 0.027, 0.041, 0.057, 0.087]),
    np.array([0, 0.012, 0.035, 0.099, 0.170, 0.240, 0.379]),
)
_PEAK = (
    np.array([0, 0.004, 0.006, 0.016, 0.023, 0.028, 0.034]),
    np.array([0, 0.035, 0.11, 0.30, 0.49, 0.68, 1.05]),
)
"""What linear theory was off by at these gradients, in tissue that does not stiffen and in one that does: the worse of
a homogeneous and a layered cube, measured in ``benchmarks/small_strain_is_off_by_a_tenth_of_the_gradient.py``."""


class TheoryError(NamedTuple):
    """What linear theory is off by, from tissue that does not stiffen (neo-Hookean) to one that does, strongly.

    The latter is exponential: its shear modulus grows by exp(b (I1 - 3)), b = 10.
    """

    mean: tuple[float, float]
    """Mean error over the mean displacement."""
    peak: tuple[float, float]
    """Of the largest displacement, over it."""

    def __repr__(self) -> str:
        mean, peak = ("{:.2g} to {:.2g}".format(*share) for share in self)
        return f"TheoryError({mean} of the mean displacement, {peak} of the largest)"


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

    @property
    def theory_error(self) -> TheoryError:
        """What the linear theory is off by at such a gradient, as measured in two cubes.

        Examples
        --------
        >>> import numpy as np
        >>> from sonospline.fields import Strain
        >>> Strain(0.307, np.zeros(3)).theory_error
        TheoryError(0.027 to 0.099 of the mean displacement, 0.016 to 0.3 of the largest)
        """
        return TheoryError(_off(self.largest, _MEAN), _off(self.largest, _PEAK))

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


def _off(gradient: float, measured: tuple[Array, Array]) -> tuple[float, float]:
    """Between what was measured, and in proportion beyond."""
    beyond = max(1.0, gradient / _GRADIENTS[-1])
    low, high = (beyond * float(np.interp(gradient, _GRADIENTS, errors)) for errors in measured)
    return low, high


def _slope(values: NDArray[np.floating], axis: int) -> NDArray[np.floating]:
    """Difference along one axis over each cell, the mean over the other two."""
    for a in range(3):
        low = values[(slice(None),) * a + (slice(None, -1),)]
        high = values[(slice(None),) * a + (slice(1, None),)]
        values = high - low if a == axis else (low + high) / 2
    return values

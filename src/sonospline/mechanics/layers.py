"""Cells of several tissues as stacks of layers: stiff along them, soft across.

A mean of moduli knows no direction. A fascia thinner than the cells carries the whole of its
tension along itself (the arithmetic mean) and hardly hinders what is across (the harmonic one):
in Backus' averages, *J. Geophys. Res.* 67 (1962) 4427, both are exact for layers that go on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .cell_samples import CellSamples
from .cell_slopes import directions

Array = NDArray[np.float64]

LEAST_CONTRAST = 1.5
"""Stiffest over softest shear modulus from which direction is worth its price."""

_AT_A_TIME = 1024
"""Cells whose values stay in the cache of a processor."""
_TRACE = np.array([1.0, 1, 1, 0, 0, 0])
_COMPONENTS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_ENGINEERING = np.diag([2.0, 2, 2, 1, 1, 1])
"""Stress of a unit shear modulus: shear strains are engineering ones."""


class Layers(NamedTuple):
    """What layered cells resist beyond their isotropic moduli, to their mean strain."""

    cells: NDArray[np.int64]
    """(n, 3) index of each."""
    excess: Array
    """(n, 6, 6) stiffness in kPa, of strains xx, yy, zz, yz, xz, xy along the grid, the last three engineering ones."""

    @classmethod
    def none(cls) -> Layers:
        """Return no layered cell."""
        return cls(np.zeros((0, 3), np.int64), np.zeros((0, 6, 6)))

    def __repr__(self) -> str:
        return f"Layers({len(self.cells)} cells)"


def layers_of(
    cells: CellSamples, lame: Array, shear: Array, shares: Array, moving: NDArray[np.bool_], spacing: Array
) -> Layers:
    """Return the layers of the cells that hold several tissues.

    Parameters
    ----------
    cells : CellSamples
        Of a grid.
    lame, shear : (materials,) ndarray
        Moduli of the materials.
    shares : (samples, mixed cells) ndarray
        Which of the samples mix, as :func:`~sonospline.mechanics.mixture.mixing_shares`.
    moving : (cx, cy, cz) ndarray of bool
        Cells that are not rigid.
    spacing : (3,) ndarray
        Sides of a cell.
    """
    stiffness = shear[cells.held]
    stiffest, softest = (
        np.where(shares > 0, stiffness, 0).max(axis=0),
        np.where(shares > 0, stiffness, np.inf).min(axis=0),
    )
    uneven = stiffest > LEAST_CONTRAST * softest
    layered = moving[cells.mixed] & uneven[cells.kind]
    which = np.argwhere(cells.mixed)[layered]
    if not len(which):
        return Layers.none()
    held, shares = cells.held[:, uneven], shares[:, uneven]
    logs = np.log(np.stack([lame + 1e-30, shear]))
    mean_lame, mean_shear = np.exp((shares * logs[:, held]).sum(axis=1))
    stacks = _stacks(lame[held], shear[held], shares, (mean_lame, mean_shear))
    kind = (np.cumsum(uneven) - 1)[cells.kind[layered]]
    return Layers(which, _turned_to(directions(cells, which, logs[1], spacing), stacks[:, kind]))


def excess_of_layers(lame: Array, shear: Array, shares: Array, normal: Array, mean: tuple[Array, Array]) -> Array:
    """Return the stiffness (n, 6, 6) of stacks of layers over that of isotropic moduli.

    Parameters
    ----------
    lame, shear : (layers, n) ndarray
        Moduli of the layers of each stack.
    shares : (layers, n) ndarray
        Their parts of it.
    normal : (n, 3) ndarray
        Direction across the layers, of unit length.
    mean : pair of (n,) ndarray
        The isotropic moduli.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.mechanics.layers import excess_of_layers
    >>> shear, half = np.array([[1.0], [9.0]]), np.full((2, 1), 0.5)
    >>> excess = excess_of_layers(0 * shear, shear, half, np.array([[0.0, 0, 1]]), (np.zeros(1), np.zeros(1)))
    >>> excess[0].diagonal().round(2).tolist()  # 2 mu: 10 along, 3.6 across; mu: 1.8 across, 5 along
    [10.0, 10.0, 3.6, 1.8, 1.8, 5.0]
    """
    return _turned_to(normal, _stacks(lame, shear, shares, mean))


def _stacks(lame: Array, shear: Array, shares: Array, mean: tuple[Array, Array]) -> Array:
    """Factors (5, n) of what stacks of layers resist beyond mean moduli: of the parts that :func:`_parts` names."""

    def average(values: Array) -> Array:
        return np.asarray((shares * values).sum(axis=0))

    stiff = lame + 2 * shear
    across = 1 / average(1 / stiff)
    coupling = across * average(lame / stiff)
    sideways = average(2 * lame * shear / stiff) + coupling**2 / across
    shear_along, shear_across = average(shear), 1 / average(1 / shear)
    return np.stack(
        [
            sideways - mean[0],
            shear_along - mean[1],
            coupling - sideways,
            across + sideways + 2 * shear_along - 2 * coupling - 4 * shear_across,
            4 * (shear_across - shear_along),
        ]
    )


def _turned_to(normal: Array, stacks: Array) -> Array:
    """The stiffness (n, 6, 6) of stacks across each direction (n, 3)."""
    found = np.empty((len(normal), 6, 6))
    for first in range(0, len(normal), _AT_A_TIME):
        some = slice(first, first + _AT_A_TIME)
        terms = zip(stacks[:, some], _parts(normal[some]), strict=True)
        found[some] = sum(factor[:, None, None] * part for factor, part in terms)
    return found


def _parts(normal: Array) -> tuple[Array, ...]:
    """Change of volume, shear in the layers' plane, both moduli across, and shear across: (n, 6, 6) or (6, 6)."""
    x, y, z = normal.T
    zero = np.zeros_like(x)
    of_normal = np.stack([x * x, y * y, z * z, y * z, x * z, x * y], axis=1)  # strain along it, stress along it
    on_normal = 0.5 * np.array(
        [[2 * x, zero, zero, zero, z, y], [zero, 2 * y, zero, z, zero, x], [zero, zero, 2 * z, y, x, zero]]
    )
    along_both = _TRACE[:, None] * of_normal[:, None, :]
    return (
        np.outer(_TRACE, _TRACE),
        _ENGINEERING,
        along_both + along_both.swapaxes(1, 2),
        of_normal[:, :, None] * of_normal[:, None, :],
        np.einsum("ian,ibn->nab", on_normal, on_normal),
    )


def turned(excess: Array, axes: Array) -> Array:
    """Return stiffnesses (n, 6, 6) along other axes, the columns of a rotation (3, 3)."""
    strains = np.zeros((6, 3, 3))
    for row, (a, b) in enumerate(_COMPONENTS):
        strains[row, a, b] = strains[row, b, a] = 1.0 if a == b else 0.5
    before = axes @ strains @ axes.T  # each strain along the other axes, along these
    turn = np.array([[strain[a, b] * (1 if a == b else 2) for strain in before] for a, b in _COMPONENTS])
    return np.asarray(turn.T @ excess @ turn)

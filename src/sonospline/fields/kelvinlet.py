"""The Kelvinlet: a matrix-valued elastic kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _core, _validate

Array = NDArray[np.float64]

_BLOCK = 60_000
"""Pairs of points and centres held at once: few enough to stay in the cache."""


@dataclass(frozen=True)
class Kelvinlet:
    """Displacement of unbounded elastic tissue by a force spread over a ball: a regularised Kelvin solution.

    With r_e^2 = r^2 + eps^2, a = 1 / (4 pi mu) and b = a / (4 (1 - nu)),

        K(x) = [ (a - b) / r_e + a eps^2 / (2 r_e^3) ] I + (b / r_e^3) x x^T

    for mu = 1. A symmetric, positive definite 3 x 3 kernel: an interpolant of displacements
    needs neither an affine part nor smoothing.

    Parameters
    ----------
    poissons_ratio : float, default: 0.45
        nu, at or above zero and below 0.5.
    width : float, default: 0.1
        eps, in the unit of the grid. Above zero.

    References
    ----------
    F. de Goes and D. L. James, Regularized Kelvinlets, ACM Trans. Graph. 36 (2017) 40.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> kernel = ss.Kelvinlet(width=0.1)
    >>> matrix = kernel.matrix(np.eye(3), np.eye(3))
    >>> matrix.shape, bool(np.linalg.eigvalsh(matrix).min() > 0)
    ((9, 9), True)
    """

    poissons_ratio: float = 0.45
    width: float = 0.1

    def __post_init__(self) -> None:
        ratio = _validate.number("poissons_ratio", self.poissons_ratio)
        if ratio >= 0.5:
            raise ValueError(f"poissons_ratio = {ratio:g} is out of range; give less than 0.5, e.g. 0.45")
        object.__setattr__(self, "width", _validate.number("width", self.width, positive=True))

    @property
    def compliance(self) -> float:
        """Displacement where a unit force acts, K(0)."""
        return float(self._radial(np.zeros(1))[0][0])

    def matrix(self, points: Array, centres: Array) -> Array:
        """Return K(p_i - c_j) as a (3m, 3n) matrix, components of a point together."""
        apart = points[:, None] - centres
        isotropic, axial, _ = self._radial((apart**2).sum(axis=-1))
        blocks = (
            isotropic[..., None, None] * np.eye(3) + axial[..., None, None] * apart[..., None] * apart[..., None, :]
        )
        return blocks.transpose(0, 2, 1, 3).reshape(3 * len(points), 3 * len(centres))

    def sum(self, points: Array, centres: Array, forces: Array) -> Array:
        """Return sum_j K(p_i - c_j) f_j at points (m, 3), as (m, 3)."""
        return _core.active.kelvinlet_sum(points, centres, forces, self.width, self.poissons_ratio)

    def gradient(self, points: Array, centres: Array, forces: Array) -> Array:
        """Return d u_a / d x_b of the same sum at points (m, 3), as (m, 3, 3)."""
        out = np.empty((len(points), 3, 3))
        rows = max(1, _BLOCK // (9 * max(1, len(centres))))
        for start in range(0, len(points), rows):
            apart = points[start : start + rows, None] - centres
            root2 = (apart**2).sum(axis=-1) + self.width**2
            _, axial, slope = self._radial(root2 - self.width**2)
            along = np.einsum("ija,ja->ij", apart, forces)
            block = np.einsum("ij,ja,ijb->iab", slope, forces, apart)
            block += np.einsum("ij,ija,jb->iab", axial, apart, forces)
            block += np.eye(3) * np.einsum("ij,ij->i", axial, along)[:, None, None]
            block -= np.einsum("ij,ija,ijb->iab", 3 * axial / root2 * along, apart, apart)
            out[start : start + rows] = block
        return out

    def _radial(self, squared: Array) -> tuple[Array, Array, Array]:
        """Factors of I and of x x^T, and the derivative of the first by r over r."""
        a = 1 / (4 * np.pi)
        b = a / (4 * (1 - self.poissons_ratio))
        root = 1 / np.sqrt(squared + self.width**2)
        cube = root**3
        isotropic = (a - b) * root + 0.5 * a * self.width**2 * cube
        slope = -(a - b) * cube - 1.5 * a * self.width**2 * cube * root**2
        return isotropic, b * cube, slope

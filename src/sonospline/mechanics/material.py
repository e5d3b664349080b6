"""What tissue is made of: a linear elastic, isotropic solid, the same everywhere or cell by cell."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _validate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Material:
    """Stiffness and compressibility of tissue in small strain.

    Parameters
    ----------
    youngs_modulus : float, default: 1.0
        E, above zero. Sets the unit of force: with lengths in mm and E in kPa, forces are
        in mN.
    poissons_ratio : float, default: 0.45
        nu, at or above zero and below 0.5.

    Raises
    ------
    ValueError
        A modulus that is not above zero, or a ratio outside [0, 0.5).

    Examples
    --------
    >>> from sonospline.mechanics import Material
    >>> Material(youngs_modulus=10).shear_modulus
    3.4482758620689657
    """

    youngs_modulus: float = 1.0
    poissons_ratio: float = 0.45

    def __post_init__(self) -> None:
        modulus = _validate.number("youngs_modulus", self.youngs_modulus, positive=True)
        ratio = _validate.number("poissons_ratio", self.poissons_ratio)
        if ratio >= 0.5:
            raise ValueError(
                f"poissons_ratio = {ratio:g} is out of range; tissue that cannot change its volume has no "
                "displacement formulation, give less than 0.5, e.g. 0.49"
            )
        object.__setattr__(self, "youngs_modulus", modulus)
        object.__setattr__(self, "poissons_ratio", ratio)

    @property
    def shear_modulus(self) -> float:
        """Second Lamé parameter, mu = E / (2 (1 + nu))."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    @property
    def first_lame(self) -> float:
        """First Lamé parameter, lambda = E nu / ((1 + nu) (1 - 2 nu))."""
        ratio = self.poissons_ratio
        return self.youngs_modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))


@dataclass(frozen=True, eq=False, repr=False)
class CellMaterial:
    """Both Lamé moduli of every cell of a grid: tissue that is stiffer here than there.

    Parameters
    ----------
    first_lame : (cx, cy, cz) array
        lambda, at or above zero; cells lie between the nodes of the grid.
    shear_modulus : (cx, cy, cz) array
        mu, above zero.

    Raises
    ------
    ValueError
        Arrays of two shapes, or a modulus out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.mechanics import CellMaterial
    >>> CellMaterial(np.full((8, 8, 8), 3.1), np.full((8, 8, 8), 0.34)).poissons_ratio
    0.45058139534883723
    """

    first_lame: Array
    shear_modulus: Array

    def __post_init__(self) -> None:
        lame, shear = (np.asarray(values, dtype=np.float64) for values in (self.first_lame, self.shear_modulus))
        if lame.ndim != 3 or lame.shape != shear.shape:
            raise ValueError(f"first_lame has shape {lame.shape} and shear_modulus {shear.shape}; give one a cell each")
        if not ((lame >= 0) & (shear > 0) & np.isfinite(lame) & np.isfinite(shear)).all():
            raise ValueError(
                f"first_lame = {lame.min():g} or shear_modulus = {shear.min():g} is out of range; "
                "give finite first moduli at or above zero and shear moduli above zero"
            )
        object.__setattr__(self, "first_lame", lame)
        object.__setattr__(self, "shear_modulus", shear)

    @property
    def poissons_ratio(self) -> float:
        """Largest of any cell, lambda / 2 (lambda + mu)."""
        return float((self.first_lame / (2 * (self.first_lame + self.shear_modulus))).max())

    def __repr__(self) -> str:
        """Name the material by all its values: kept results are found by it."""
        values = hashlib.sha256(self.first_lame.tobytes() + self.shear_modulus.tobytes()).hexdigest()[:16]
        return f"CellMaterial({self.first_lame.shape} cells, {values})"

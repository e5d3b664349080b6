"""Stiffness of each cell of the solver's grid."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid
from .material import Material

Array = NDArray[np.float64]

LARGEST_CONTRAST = 1e6
"""Stiffest over softest shear modulus, at most."""
SMALLEST_MODULUS, LARGEST_MODULUS = 1e-9, 1e12
"""In kPa, from a smoke to a diamond: what float32 can square."""
INTEGRATIONS = ("full", "mean_dilatation")
"""How finite elements take a cell's change of volume: at every point, or by its mean (B-bar), which does not lock."""
LARGEST_RATIO = 0.49
"""Poisson's ratio, at most: beyond it multigrid converges too slowly to be live."""

_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Moduli:
    """Both Lamé moduli of every cell, in the material's unit of stress (kPa).

    Parameters
    ----------
    grid : Grid
        The nodes; cells lie between them.
    lame : (cx, cy, cz) ndarray
        First modulus, lambda; at or above zero.
    shear : (cx, cy, cz) ndarray
        Second modulus, mu; above zero.

    Raises
    ------
    ValueError
        A modulus out of range, a contrast above a million, or cells nearer to
        incompressible than Poisson's ratio 0.49 (fluids excepted, see
        :class:`sonospline.mechanics.Material`).
    """

    grid: Grid
    lame: Array
    shear: Array

    def __post_init__(self) -> None:
        cells = tuple(n - 1 for n in self.grid.shape)
        for name, values in (("lame", self.lame), ("shear", self.shear)):
            if values.shape != cells:
                raise ValueError(f"{name} has shape {values.shape}; give {cells}, one value a cell of the grid")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} contains NaN or infinity; give finite moduli")
        if (self.shear <= 0).any() or (self.lame < 0).any():
            raise ValueError(
                f"shear = {self.shear.min():g} or lame = {self.lame.min():g} is out of range; "
                "give shear moduli above zero and first moduli at or above zero"
            )
        if self.shear.min() < SMALLEST_MODULUS or max(self.shear.max(), self.lame.max()) > LARGEST_MODULUS:
            raise ValueError(
                f"shear moduli from {self.shear.min():.3g} to {self.shear.max():.3g} are beyond the solver's range; "
                f"give stiffness in kPa, {SMALLEST_MODULUS:g} to {LARGEST_MODULUS:g}"
            )
        contrast = self.shear.max() / self.shear.min()
        if contrast > LARGEST_CONTRAST * (1 + _ROUNDING):
            raise ValueError(
                f"shear moduli differ by {contrast:.3g} times; give a contrast of at most {LARGEST_CONTRAST:g} "
                "(bone is rigid beside soft tissue at a thousand already)"
            )

    @classmethod
    def uniform(cls, grid: Grid, material: Material) -> Moduli:
        """Return one material everywhere."""
        check_ratio(material.poissons_ratio)
        cells = tuple(n - 1 for n in grid.shape)
        return cls(grid, np.full(cells, material.first_lame), np.full(cells, material.shear_modulus))

    def __repr__(self) -> str:
        """Name the moduli by all their values: kept results are found by it."""
        values = hashlib.sha256(self.lame.tobytes() + self.shear.tobytes()).hexdigest()[:16]
        return f"Moduli({' x '.join(map(str, self.shear.shape))} cells, {values})"

    @property
    def lame_moduli(self) -> tuple[Array, Array]:
        """First and second modulus of each cell."""
        return self.lame, self.shear

    @property
    def poissons_ratio(self) -> float:
        """Largest Poisson's ratio of any cell, lambda / 2 (lambda + mu)."""
        return float((self.lame / (2 * (self.lame + self.shear))).max())


def check_ratio(ratio: float, name: str = "poissons_ratio") -> None:
    """Raise ValueError where Poisson's ratio is too near to that of a liquid for a live solver."""
    if not 0 <= ratio <= LARGEST_RATIO + _ROUNDING:
        raise ValueError(
            f"{name} = {ratio:g} is out of range; give 0 to {LARGEST_RATIO} (soft tissue: 0.45), or fluid = true"
        )

"""Stiffness of each cell of the solver's grid."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid
from .continued_walls import ContinuedWalls
from .fragments import Numbers, corners_of
from .held_bone import HeldBone
from .layers import Layers
from .material import Material

Array = NDArray[np.float64]
Cells = NDArray[np.bool_]

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
    rigid : (cx, cy, cz) ndarray of bool, optional
        Cells that do not deform, whatever their moduli: bone.
    fragments : (cx, cy, cz) ndarray of int, optional
        Number of the fragment, from 1 on, that a rigid cell moves with; 0 of rigid cells that do not move.
    layers : Layers, optional
        Cells that are stiffer along their layers than across; by default there are none.
    bone : HeldBone, optional
        Cells that are bone in part, which holds their corners; by default there are none.
    walls : ContinuedWalls, optional
        Walls beyond which tissue goes on; by default there are none.

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
    rigid: Cells = field(default_factory=lambda: np.zeros((0, 0, 0), bool))
    fragments: Numbers = field(default_factory=lambda: np.zeros((0, 0, 0), np.int32))
    layers: Layers = field(default_factory=Layers.none)
    bone: HeldBone = field(default_factory=HeldBone.none)
    walls: ContinuedWalls = field(default_factory=ContinuedWalls.none)

    def __post_init__(self) -> None:
        cells = tuple(n - 1 for n in self.grid.shape)
        for name, kind in (("rigid", bool), ("fragments", np.int32)):
            given = getattr(self, name)
            if not given.size:
                object.__setattr__(self, name, np.zeros(cells, kind))
            elif given.shape != cells:
                raise ValueError(f"{name} has shape {given.shape}; give {cells}, one value a cell of the grid")
        if self.rigid.all():
            raise ValueError(
                "every cell of the grid is rigid, so nothing can move; give a larger box, more nodes, or "
                "materials of which some are not rigid"
            )
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
        contrast = self.contrast
        if contrast > LARGEST_CONTRAST * (1 + _ROUNDING):
            raise ValueError(
                f"shear moduli differ by {contrast:.3g} times; give a contrast of at most {LARGEST_CONTRAST:g} "
                "(rigid = true for bone)"
            )

    @classmethod
    def uniform(cls, grid: Grid, material: Material) -> Moduli:
        """Return one material everywhere."""
        check_ratio(material.poissons_ratio)
        cells = tuple(n - 1 for n in grid.shape)
        return cls(grid, np.full(cells, material.first_lame), np.full(cells, material.shear_modulus))

    def __repr__(self) -> str:
        """Name the moduli by all their values: kept results are found by it."""
        arrays = (self.lame, self.shear, self.rigid, self.fragments, *self.layers, *self.bone, *self.walls)
        values = hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()[:16]
        return f"Moduli({' x '.join(map(str, self.shear.shape))} cells, {values})"

    @property
    def lame_moduli(self) -> tuple[Array, Array]:
        """First and second modulus of each cell."""
        return self.lame, self.shear

    @property
    def contrast(self) -> float:
        """Stiffest over softest shear modulus."""
        return float(self.shear.max() / self.shear.min())

    @cached_property
    def rigid_nodes(self) -> Cells:
        """Nodes (nx, ny, nz) that are a corner of a rigid cell."""
        return corners_of(self.rigid)

    @cached_property
    def springs(self) -> Array:
        """Springs (3, nx, ny, nz) along the axes that hold nodes, as :meth:`springs_of` these moduli."""
        return self.springs_of(self.lame, self.shear)

    def springs_of(self, lame: Array, shear: Array) -> Array:
        """Return the springs (3, nx, ny, nz), kPa mm, by which bone and walls hold nodes of tissue of other moduli."""
        return self.bone.at_nodes(lame, shear, self.grid.spacing) + self.walls.at_nodes(shear)

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

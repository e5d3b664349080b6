"""What tissue is made of: a linear elastic, isotropic solid, and what a needle in it meets."""

from __future__ import annotations

from dataclasses import dataclass

from .. import _validate

FLUID_SHEAR = 0.01
"""A fluid keeps its first modulus and this share of the second: it shears freely, at constant volume."""


@dataclass(frozen=True)
class Material:
    """One tissue: its stiffness in small strain, and what a needle in it meets.

    A field here is all a new property needs beside its effect: tables of materials, their error
    messages and their documentation follow from these.

    Parameters
    ----------
    stiffness_kpa : float, default: 1.0
        Young's modulus E, above zero. With lengths in mm forces are in mN; studies of the unit
        cube leave it at 1.
    poissons_ratio : float, default: 0.45
        nu, at or above zero and below 0.5; live solvers take at most 0.49.
    friction_n_per_mm : float, default: 0.03
        Force per length along a shaft, at or above zero.
    cutting_force_n : float, default: 0.7
        Force at an advancing tip, at or above zero.
    rigid : bool, default: False
        Bone: a cell is all bone where most of it is, and else none. Mixing would smear it.
    fluid : bool, default: False
        A hundredth of the shear modulus with the compressibility kept.
    source : str, default: "assumed"
        Where the values come from.

    Raises
    ------
    ValueError
        A value out of range.

    Examples
    --------
    >>> from sonospline.mechanics import Material
    >>> Material(stiffness_kpa=10).shear_modulus
    3.4482758620689657
    >>> [round(modulus, 3) for modulus in Material(6).lame_moduli]
    [18.621, 2.069]
    """

    stiffness_kpa: float = 1.0
    poissons_ratio: float = 0.45
    friction_n_per_mm: float = 0.03
    cutting_force_n: float = 0.7
    rigid: bool = False
    fluid: bool = False
    source: str = "assumed"

    def __post_init__(self) -> None:
        for name in ("stiffness_kpa", "poissons_ratio", "friction_n_per_mm", "cutting_force_n"):
            value = _validate.number(name, getattr(self, name), positive=name == "stiffness_kpa")
            object.__setattr__(self, name, value)
        if self.poissons_ratio >= 0.5:
            raise ValueError(
                f"poissons_ratio = {self.poissons_ratio:g} is out of range; tissue that cannot change its volume has "
                "no displacement formulation, give less than 0.5, e.g. 0.49, or fluid = true"
            )

    @property
    def shear_modulus(self) -> float:
        """Second Lamé parameter in kPa, mu = E / (2 (1 + nu)); a hundredth of it in a fluid."""
        solid = self.stiffness_kpa / (2 * (1 + self.poissons_ratio))
        return solid * (FLUID_SHEAR if self.fluid else 1.0)

    @property
    def first_lame(self) -> float:
        """First Lamé parameter in kPa, lambda = E nu / ((1 + nu) (1 - 2 nu))."""
        ratio = self.poissons_ratio
        return self.stiffness_kpa * ratio / ((1 + ratio) * (1 - 2 * ratio))

    @property
    def lame_moduli(self) -> tuple[float, float]:
        """First and second Lamé parameter in kPa."""
        return self.first_lame, self.shear_modulus

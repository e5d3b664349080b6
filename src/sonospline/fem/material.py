"""What tissue is made of: a linear elastic, isotropic, homogeneous solid."""

from __future__ import annotations

from dataclasses import dataclass

from .. import _validate


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
    >>> from sonospline.fem import Material
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

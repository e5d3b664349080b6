"""How the force of a pressed probe grows faster than its depth: Fung's exponential, of all the energy stored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import _validate

_CM2 = 100.0
"""mm2."""


@dataclass(frozen=True)
class Stiffening:
    """Tissue that stores more energy than linear elastic tissue with the same dent: W = E0 (exp(E / E0) - 1).

    E is what the linear tissue would store, and E0 an energy for each area of the probe's face. This is Fung's law
    (*Am. J. Physiol.* 213 (1967) 1532) with the strain energy of all the tissue together in the place of that of one
    point. W rises with E: of all displacements that a rigid face allows, the one of least E has least W, so that the
    dent is that of linear tissue. Force and pressure are those of linear tissue times dW/dE = exp(E / E0); they are the
    derivative of W, hence what a press takes is what its way back returns, and the force rises with the depth.

    Parameters
    ----------
    energy_mj_cm2 : float
        E0 over the area of the face, mJ/cm2, above zero: where so much would be stored, force is e times as large.

    Examples
    --------
    >>> from sonospline.mechanics import Stiffening
    >>> stiffening = Stiffening(energy_mj_cm2=4.0)
    >>> round(stiffening.factor(40.0, area_mm2=1000.0), 3), round(stiffening.energy_mj(40.0, area_mm2=1000.0), 1)
    (2.718, 68.7)
    """

    energy_mj_cm2: float

    def __post_init__(self) -> None:
        known = _validate.number("energy_mj_cm2", self.energy_mj_cm2, positive=True)
        object.__setattr__(self, "energy_mj_cm2", known)

    def factor(self, linear_mj: float, area_mm2: float) -> float:
        """Return the force over that of linear tissue which stores an energy under a face of an area."""
        return float(np.exp(linear_mj / self._scale(area_mm2)))

    def energy_mj(self, linear_mj: float, area_mm2: float) -> float:
        """Return what is stored where linear tissue would store an energy under a face of an area."""
        scale = self._scale(area_mm2)
        return float(scale * np.expm1(linear_mj / scale))

    def _scale(self, area_mm2: float) -> float:
        return self.energy_mj_cm2 * area_mm2 / _CM2

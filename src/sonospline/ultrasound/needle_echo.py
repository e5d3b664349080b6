"""The needle in the image: shaft, tip, reverberation, shadow, and how all fade with angle and distance.

The shaft's brightness against angle is fitted to measurements of nine needles in a PVA phantom (van de Berg
et al. 2018, doi 10.1016/j.ultrasmedbio.2018.10.004). All smooth shafts there are brightest at 76.5 to 78.2
degrees, not 90: an offset of that set-up. Here the angle is from square to the local beam, so that 0 stands
for the fitted maximum (78.15 degrees for the 2 mm steel shaft).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .probe import SPEED_OF_SOUND

Array = NDArray[np.float64]

_BRIGHTEST_DB = 28.0
_TIP_DB, _TIP_FLOOR_DB, _TIP_WIDTH_DEG = 24.0, 4.0, 35.0
_SHADE, _REAL_SHADE = 0.55, 0.58

_COLUMNS = ("floor", "height", "width_deg", "centre_deg", "diameter_mm")
_MEASURED: dict[str, tuple[Literal["gaussian", "lorentzian"], float, float, float, float, float]] = {
    "trocar 18G": ("lorentzian", 1.95, 10.35, 13.2, 77.95, 1.27),
    "steel 2 mm": ("gaussian", 1.02, 9.30, 8.38, 78.15, 2.0),
    "steel 1 mm": ("gaussian", 0.61, 11.8, 8.65, 76.5, 1.0),
    "echogenic 2 mm": ("gaussian", 0.0, 9.30, 73.4, 82.2, 2.0),
}


@dataclass(frozen=True, kw_only=True)
class NeedleEcho:
    """How a needle looks.

    Parameters
    ----------
    name : str
        What it is.
    shape : {"gaussian", "lorentzian"}
        Fall of the shaft's contrast-to-noise ratio with angle.
    floor, height, width_deg : float
        CNR(beta) = floor + height f(beta / width), f = exp(-x^2/2) or 1/(1 + x^2).
    centre_deg : float
        Angle of the set-up at which the fit has its maximum; only for comparison with the measurements.
    diameter_mm : float
        Of the shaft.
    core_speed : float, default: 5.9
        Speed of sound in the shaft, mm per microsecond: of steel; of its filling, for a lumen that rings.

    Examples
    --------
    >>> from sonospline.ultrasound import NeedleEcho
    >>> steel, trocar = NeedleEcho.steel_2mm(), NeedleEcho.trocar()
    >>> [round(float(needle.shaft_db(25.0)), 1) for needle in (steel, trocar)]
    [3.1, 9.6]
    """

    name: str
    shape: Literal["gaussian", "lorentzian"]
    floor: float
    height: float
    width_deg: float
    centre_deg: float
    diameter_mm: float
    core_speed: float = 5.9

    def __post_init__(self) -> None:
        _validate.choice("shape", self.shape, ("gaussian", "lorentzian"))
        for name in ("height", "width_deg", "diameter_mm", "core_speed"):
            _validate.number(name, getattr(self, name), positive=True)
        _validate.number("floor", self.floor)
        _validate.real("centre_deg", self.centre_deg)

    @classmethod
    def trocar(cls) -> NeedleEcho:
        """Return an 18 G trocar, bright over a wide range of angles: the default."""
        return cls._measured("trocar 18G")

    @classmethod
    def steel_2mm(cls) -> NeedleEcho:
        """Return a smooth steel shaft of 2 mm, which vanishes beyond 25 degrees from square."""
        return cls._measured("steel 2 mm")

    @classmethod
    def steel_1mm(cls) -> NeedleEcho:
        """Return a smooth steel shaft of 1 mm."""
        return cls._measured("steel 1 mm")

    @classmethod
    def echogenic_2mm(cls) -> NeedleEcho:
        """Return a steel shaft of 2 mm with two cuts around it, which send the beam back from nearly every angle."""
        return cls._measured("echogenic 2 mm")

    @classmethod
    def _measured(cls, name: str) -> NeedleEcho:
        shape, *numbers = _MEASURED[name]
        return cls(name=name, shape=shape, **dict(zip(_COLUMNS, numbers, strict=True)))

    def cnr(self, beta_deg: ArrayLike) -> Array:
        """Return the fitted contrast-to-noise ratio at an angle from square to the beam."""
        x = np.asarray(beta_deg, float) / self.width_deg
        return self.floor + self.height * (np.exp(-(x**2) / 2) if self.shape == "gaussian" else 1 / (1 + x**2))

    def shaft_db(self, beta_deg: ArrayLike) -> Array:
        """Return the shaft's level above liver speckle: 28 dB when square, linear in CNR."""
        return _BRIGHTEST_DB * self.cnr(beta_deg) / self.cnr(0.0)

    def tip_db(self, beta_deg: ArrayLike) -> Array:
        """Return the tip's level above liver speckle (set by eye, not fitted)."""
        return _TIP_DB * np.exp(-((np.asarray(beta_deg, float) / _TIP_WIDTH_DEG) ** 2) / 2) + _TIP_FLOOR_DB

    @property
    def reverberation_mm(self) -> float:
        """Spacing of the reverberation as displayed: d c_tissue / c_core."""
        return self.diameter_mm * SPEED_OF_SOUND / self.core_speed

    def shaded(self, elevation_mm: ArrayLike, sigma_mm: ArrayLike, *, real: bool = False) -> Array:
        """Return the amplitude left below the shaft, (1 - k C)^2, C the covered share of the slice."""
        from scipy.special import erf

        y, width = np.asarray(elevation_mm, float), 2 * np.asarray(sigma_mm, float)
        half = self.diameter_mm / 2
        covered = (erf((y + half) / width) - erf((y - half) / width)) / 2
        return (1 - (_REAL_SHADE if real else _SHADE) * covered) ** 2


LOOKS = {
    "trocar": NeedleEcho.trocar, "echogenic-2mm": NeedleEcho.echogenic_2mm, "steel-2mm": NeedleEcho.steel_2mm,
    "steel-1mm": NeedleEcho.steel_1mm,
}  # fmt: skip
"""Needles by the names that scene files and the command line give them."""

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
from ..geometry import pose
from ..geometry.needle import Needle
from .optics import CUT_WEIGHT, ELEVATION_CUT, Optics
from .probe import SPEED_OF_SOUND

Array = NDArray[np.float64]

POINT_MM = 0.12
_BRIGHTEST_DB = 28.0
_COPIES = 8
_COPY_FACTOR = 0.62
_COPY_WIDTH_DEG = 12.0
_TIP_DB, _TIP_FLOOR_DB, _TIP_WIDTH_DEG = 24.0, 4.0, 35.0
_SHADE = 0.55
_JITTER = 0.18
SHADOW_SOFT_MM = 0.5
_SHADOW_LINES = 1.5

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

    def shaded(self, elevation_mm: ArrayLike, sigma_mm: ArrayLike) -> Array:
        """Return the amplitude left below the shaft, (1 - k C)^2, C the covered share of the slice."""
        from scipy.special import erf

        y, width = np.asarray(elevation_mm, float), 2 * np.asarray(sigma_mm, float)
        half = self.diameter_mm / 2
        covered = (erf((y + half) / width) - erf((y - half) / width)) / 2
        return (1 - _SHADE * covered) ** 2


def echo(
    model: NeedleEcho, needle: Needle, optics: Optics, transform: Array, seed: int = 0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return a needle's echoes (m, 4): line, half-sample, real and imaginary part; and its shadow (2, lines).

    Echoes have one phase all along: with the carrier's, the beam would cancel an oblique line. The shadow is
    the range where it begins, and the amplitude left below.
    """
    probe = optics.probe
    shaft = needle.at(np.linspace(0, 1, max(2, int(needle.depth / POINT_MM) + 1)))
    points = pose.to_image(transform, shaft)
    r, line, elevation = probe.beam_coordinates(points).T
    sigma = probe.elevation_sigma(r)
    profile = np.exp(-0.5 * (elevation / sigma) ** 2) - CUT_WEIGHT
    seen = (
        (np.abs(elevation) < ELEVATION_CUT * sigma)
        & (r > 0)
        & (r < probe.depth_mm)
        & (line > -2)
        & (line < probe.lines + 1)
    )
    no_shadow = np.stack([np.full(probe.lines, 2 * probe.depth_mm), np.ones(probe.lines)]).astype(np.float32)
    if not seen.any():
        return np.zeros((0, 4), np.float32), no_shadow
    direction = transform[:3, :3].T @ needle.direction
    sine = np.abs(probe.beam_directions(points) @ direction)
    beta = np.degrees(np.arcsin(np.clip(sine, 0, 1)))
    rms = np.sqrt(optics.power_at(r))
    # one point's share of a line that is as bright as wanted: the beam sees sqrt(2 pi) s_along of it
    along = 1 / np.sqrt((1 - sine**2) / probe.lateral_sigma(r) ** 2 + sine**2 / probe.axial_sigma**2)
    step = needle.depth / (len(shaft) - 1)
    amplitude = (10 ** (model.shaft_db(beta) / 20) - 1) * rms * step / (np.sqrt(2 * np.pi) * along)
    amplitude *= _jitter(len(shaft), step, seed) * profile
    ring = np.exp(-((beta / _COPY_WIDTH_DEG) ** 2) / 2)
    copies = np.arange(_COPIES + 1)
    strength = np.where(copies[:, None] == 0, 1.0, ring * _COPY_FACTOR ** copies[:, None]) * amplitude
    later = r + copies[:, None] * model.reverberation_mm
    lines = np.broadcast_to(line, later.shape)
    tip = 10 ** (model.tip_db(beta[-1]) / 20) * rms[-1] * profile[-1] * seen[-1]
    parts = [np.append(a[:, seen].ravel(), b) for a, b in ((lines, line[-1]), (later, r[-1]), (strength, tip))]
    echoes = np.column_stack([parts[0], parts[1] / optics.half_sample_mm, parts[2], np.zeros(len(parts[0]))])
    return echoes.astype(np.float32), _shadow(
        model, r[seen], line[seen], elevation[seen], sigma[seen], probe.lines, no_shadow
    )


def _shadow(
    model: NeedleEcho, r: Array, line: Array, elevation: Array, sigma: Array, lines: int, none: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Where the shadow begins on each line, and the amplitude left, softened across lines."""
    from scipy.ndimage import gaussian_filter1d

    shadow = none.copy()
    number = np.rint(line).astype(int)
    held = (number >= 0) & (number < lines)
    begins = np.full(lines, np.inf)
    np.minimum.at(begins, number[held], r[held])
    covered = np.ones(lines)
    np.minimum.at(covered, number[held], model.shaded(elevation, sigma)[held])
    met = np.flatnonzero(np.isfinite(begins))
    if len(met):
        every = np.arange(lines)
        shadow[0] = np.interp(every, met, begins[met]) + model.diameter_mm
        between = (every >= met[0]) & (every <= met[-1])
        left = np.where(between, np.interp(every, met, covered[met]), 1.0)
        shadow[1] = gaussian_filter1d(left, _SHADOW_LINES, mode="nearest")
    return shadow


def _jitter(count: int, step_mm: float, seed: int) -> Array:
    """A slow log-normal ripple along the shaft, fixed to its tip's end."""
    from scipy.ndimage import gaussian_filter1d

    width = max(1.0, 1.5 / step_mm)
    noise = gaussian_filter1d(np.random.default_rng(seed).standard_normal(count + int(8 * width)), width)[:count]
    return np.exp(_JITTER * noise / max(float(noise.std()), 1e-9))


LOOKS = {
    "trocar": NeedleEcho.trocar, "echogenic-2mm": NeedleEcho.echogenic_2mm, "steel-2mm": NeedleEcho.steel_2mm,
    "steel-1mm": NeedleEcho.steel_1mm,
}  # fmt: skip
"""Needles by the names that scene files and the command line give them."""

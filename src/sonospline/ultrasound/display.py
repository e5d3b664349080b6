"""The scanner's knobs: what becomes of the echoes on their way to grey levels."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._shown import shown
from .probe import Probe

Array = NDArray[np.float64]

TGC_SLIDERS = 8
_MOST_TGC_DB = 30.0

IMPERFECT_TGC_DB = (1.5, -2.0, 0.5, 2.5, -1.0, 1.0, -3.0, 2.0)
"""Sliders as a hand leaves them: bands one can see, set by eye."""


def _curve(*knots: tuple[int, int]) -> NDArray[np.uint8]:
    seen, shown_as = zip(*knots, strict=True)
    return np.rint(np.interp(np.arange(256), seen, shown_as)).astype(np.uint8)


GREY_MAPS = MappingProxyType(
    {
        "linear": _curve((0, 0), (255, 255)),
        "soft": np.rint(255 * np.linspace(0, 1, 256) ** 0.75).astype(np.uint8),
        "contrast": np.rint(255 * (0.5 - 0.5 * np.cos(np.pi * np.linspace(0, 1, 256)))).astype(np.uint8),
        "dark": np.rint(255 * np.linspace(0, 1, 256) ** 1.5).astype(np.uint8),
        "reject": _curve((0, 0), (40, 0), (120, 118), (255, 255)),
    }
)
"""Grey maps by name, (256,) each: what a level of the log-compressed echo is shown as."""


@dataclass(frozen=True, kw_only=True)
class Display:
    """The scanner's knobs.

    Parameters
    ----------
    gain_db : float, default: -31
        Grey level of everything; -31 shows liver at the surface in the middle of a 60 dB range.
    range_db : float, default: 60
        Dynamic range from black to white.
    tgc_db_cm_mhz : float, default: 0.6
        Attenuation that time-gain compensation makes up for, one way.
    noise_db : float, default: -76
        Electronic noise relative to liver speckle at the surface; time-gain compensation amplifies it with depth.
    tgc_db : tuple of float, optional
        Eight sliders, from the face to the deepest: dB added in the middle of each eighth of the depth, linear
        between. ``IMPERFECT_TGC_DB`` are as a hand leaves them; by default all stand in the middle.
    grey_map : str, default: "linear"
        What levels are shown as in the picture: one of ``GREY_MAPS``.

    Raises
    ------
    ValueError
        A number that is not finite, other than eight sliders or one beyond 30 dB, or a grey map that is not known.

    Examples
    --------
    >>> from sonospline.ultrasound import Display, Probe
    >>> display = Display(tgc_db=(0, 0, 0, 0, 0, 0, 6, 6))
    >>> [round(float(g), 1) for g in display.slider_db(Probe.linear())[::256]]
    [0.0, 0.0, 0.0, 3.0]
    """

    gain_db: float = -31.0
    range_db: float = 60.0
    tgc_db_cm_mhz: float = 0.6
    noise_db: float = -76.0
    tgc_db: tuple[float, ...] = ()
    grey_map: str = "linear"

    def __post_init__(self) -> None:
        _validate.number("range_db", self.range_db, positive=True)
        _validate.number("tgc_db_cm_mhz", self.tgc_db_cm_mhz)
        for name in ("gain_db", "noise_db"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{name} = {getattr(self, name)} is not finite; give dB")
        _validate.choice("grey_map", self.grey_map, tuple(GREY_MAPS))
        object.__setattr__(self, "tgc_db", _sliders(self.tgc_db))

    def slider_db(self, probe: Probe) -> Array:
        """Return what the sliders add at each sample, (samples,) dB."""
        return slider_db(self.tgc_db, probe.depth_mm, probe.ranges)

    def offset_db(self, probe: Probe, speckle_power: Array) -> NDArray[np.float32]:
        """What brings the logarithm of the power to the display: the speckle's own taken out, TGC and gain added."""
        tgc = 2 * self.tgc_db_cm_mhz * probe.frequency_mhz * probe.ranges / 10
        offset = tgc - 10 * np.log10(speckle_power) + self.gain_db
        return (offset + self.slider_db(probe) if self.tgc_db else offset).astype(np.float32)

    def mapped(self, grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return grey levels as the map shows them."""
        return grey if self.grey_map == "linear" else GREY_MAPS[self.grey_map][grey]


def slider_db(tgc_db: tuple[float, ...], depth_mm: float, range_mm: NDArray[np.floating]) -> Array:
    """Return what sliders add at ranges of an image so deep, dB: theirs in the middle of each part, linear between."""
    if not tgc_db:
        return np.zeros(np.shape(range_mm))
    middles = (np.arange(TGC_SLIDERS) + 0.5) * depth_mm / TGC_SLIDERS
    return np.interp(range_mm, middles, tgc_db)


def _sliders(given: tuple[float, ...]) -> tuple[float, ...]:
    try:
        sliders = tuple(float(value) for value in given)
    except (TypeError, ValueError):
        raise ValueError(f"tgc_db = {shown(given)} are no sliders; give {TGC_SLIDERS} numbers in dB") from None
    if sliders and len(sliders) != TGC_SLIDERS:
        raise ValueError(f"tgc_db has {len(sliders)} sliders; give {TGC_SLIDERS} numbers in dB, from the face down")
    for number, value in enumerate(sliders):
        if not abs(value) <= _MOST_TGC_DB:
            raise ValueError(
                f"tgc_db[{number}] = {value} is out of range; give -{_MOST_TGC_DB:g} to {_MOST_TGC_DB:g} dB"
            )
    return sliders

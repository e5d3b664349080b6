"""Settings of colour Doppler, and the beams that listen to its box."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._shown import shown
from .probe import PROBES, SPEED_OF_SOUND, Probe

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

_NARROWER = 0.35
"""Bandwidth of a Doppler pulse over that of one for the grey image: it is thrice as long."""
_LINES_PER_BEAM, _SAMPLES_PER_SIGMA = 1.5, 1.5
_FEWEST_LINES, _FEWEST_SAMPLES, _MOST_PULSES, _STEEPEST_DEG = 16, 64, 64, 30.0


@dataclass(frozen=True, kw_only=True)
class Doppler:
    """Colour Doppler: several pulses along each beam of a box, and how far the phase turns between them.

    Parameters
    ----------
    box_mm : (float, float, float, float)
        Left, right, top and bottom in the image, from the middle of the probe's face; of a convex face left and right
        along its arc. Where beams are steered, left and right are those in the middle of the box.
    prf_hz : float, default: 3000
        Pulses a second.
    ensemble : int, default: 10
        Pulses along a beam.
    steer_deg : float, default: 0
        By how much the beams of a linear probe lean to the right; a vessel along the skin is square to those that
        go straight down.
    wall_filter : int, default: 1
        Order of the polynomial in time that is taken out of each ensemble: tissue, which hardly moves. 0 takes its
        mean; more takes slow flow, too.
    threshold_db : float, default: 5
        Power over the noise below which nothing is shown.

    Raises
    ------
    ValueError
        A box without area, a repetition frequency that is not above zero, fewer than two pulses or no more than the
        filter takes, or beams steered by more than 30 degrees.

    Examples
    --------
    >>> from sonospline.ultrasound import Doppler, Probe
    >>> doppler = Doppler(box_mm=(-12, 12, 14, 34), prf_hz=4000, steer_deg=20)
    >>> round(doppler.nyquist_cm_s(Probe.linear()), 1)
    20.5
    """

    box_mm: Box
    prf_hz: float = 3000.0
    ensemble: int = 10
    steer_deg: float = 0.0
    wall_filter: int = 1
    threshold_db: float = 5.0

    def __post_init__(self) -> None:
        try:
            left, right, top, bottom = (float(side) for side in self.box_mm)
        except (TypeError, ValueError):
            raise ValueError(f"box_mm = {shown(self.box_mm)} is no box; give left, right, top, bottom in mm") from None
        if not (np.isfinite([left, right, top, bottom]).all() and left < right and 0 <= top < bottom):
            raise ValueError(
                f"box_mm = {self.box_mm} is no box; give left < right and 0 <= top < bottom, mm from the probe's face"
            )
        object.__setattr__(self, "box_mm", (left, right, top, bottom))
        _validate.number("prf_hz", self.prf_hz, positive=True)
        _validate.count("ensemble", self.ensemble, least=2)
        if self.ensemble > _MOST_PULSES:
            raise ValueError(f"ensemble = {self.ensemble} is too many pulses; give 2 to {_MOST_PULSES}")
        _validate.count("wall_filter", self.wall_filter, least=0)
        if self.wall_filter > self.ensemble - 2:
            raise ValueError(
                f"wall_filter = {self.wall_filter} leaves nothing of ensemble = {self.ensemble} pulses; "
                f"give at most {self.ensemble - 2}"
            )
        _validate.real("threshold_db", self.threshold_db)
        if abs(_validate.real("steer_deg", self.steer_deg)) > _STEEPEST_DEG:
            raise ValueError(f"steer_deg = {self.steer_deg} is too steep; give {-_STEEPEST_DEG:g} to {_STEEPEST_DEG:g}")

    def nyquist_cm_s(self, probe: Probe) -> float:
        """Return the largest velocity along the beam that is not shown as another, PRF c / (4 f0), cm/s."""
        return 0.1 * SPEED_OF_SOUND * self.prf_hz / (4 * probe.frequency_mhz)

    def check(self, probe: Probe) -> None:
        """Raise ValueError where the probe cannot listen to the box: it reaches beyond the image, or is too deep."""
        if probe.kind == "phased":
            raise ValueError("a phased probe has no colour box here; give a linear or a curvilinear one")
        if probe.curved and self.steer_deg:
            raise ValueError(f"steer_deg = {self.steer_deg} is not for a convex face, whose beams fan out; give 0")
        left, right, _, bottom = self.box_mm
        half = probe.aperture_mm / 2
        lean = self._tangent * (bottom - self._middle[1])
        if left - abs(lean) < -half - 1e-9 or right + abs(lean) > half + 1e-9 or bottom > probe.depth_mm + 1e-9:
            steered = f", steered by {self.steer_deg:g} degrees," if self.steer_deg else ""
            raise ValueError(
                f"box_mm = {self.box_mm}{steered} reaches beyond the image, which is {-half:g} to {half:g} mm wide and "
                f"{probe.depth_mm:g} mm deep; give a box inside it"
            )
        fastest = self.fastest_prf_hz(probe)
        if self.prf_hz > fastest:
            raise ValueError(
                f"prf_hz = {self.prf_hz:g} sends before the last pulse is back from the bottom of the box; "
                f"give at most {fastest:.4g}"
            )

    def fastest_prf_hz(self, probe: Probe) -> float:
        """Return as many pulses a second as are back before the next, c / (2 depth), Hz."""
        return 1e6 * SPEED_OF_SOUND / (2 * self.beams(probe).depth_mm)

    def beams(self, probe: Probe) -> Probe:
        """Return the probe that the box is heard by: as wide as it, its pulse thrice as long."""
        left, right, _, bottom = self.box_mm
        cos = float(np.cos(np.radians(self.steer_deg)))
        across, middle = (right - left) * cos, self._middle[1]
        beam = float(probe.lateral_fwhm(middle)) * (probe.apex_mm / (probe.apex_mm + middle) if probe.curved else 1)
        length = probe.axial_sigma / _NARROWER
        depth = bottom / cos + 2 * self._lead
        settings = {field.name: getattr(probe, field.name) for field in fields(probe) if field.name != "kind"} | {
            "aperture_mm": across, "depth_mm": depth, "bandwidth": _NARROWER * probe.bandwidth,
            "samples": max(_FEWEST_SAMPLES, 16 * int(np.ceil(_SAMPLES_PER_SIGMA * depth / length / 16))),
            "lines": max(_FEWEST_LINES, int(np.ceil(_LINES_PER_BEAM * across / beam)) + 1),
        }  # fmt: skip
        return PROBES[probe.kind](**settings)

    def pose(self, probe: Probe) -> Array:
        """Return where that probe is in the frame of the real one, (4, 4)."""
        middle, depth = self._middle
        found = np.eye(4)
        if probe.curved:  # about the point that the beams fan out from
            angle, apart = middle / probe.apex_mm, probe.apex_mm
            face = apart * np.array([np.sin(angle), np.cos(angle) - 1, 0.0])
        else:
            angle = np.radians(self.steer_deg)
            face = np.array([middle, depth, 0.0])
            face -= (depth / np.cos(angle) + self._lead) * np.array([np.sin(angle), np.cos(angle), 0.0])
        found[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        found[:3, 3] = face
        return found

    def inside(self, probe: Probe, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.bool_]:
        """Return whether places in the image, mm from the middle of the face, are in the box."""
        left, right, top, bottom = self.box_mm
        if probe.curved:
            across = probe.apex_mm * np.arctan2(x, y + probe.apex_mm)
            deep = np.hypot(x, y + probe.apex_mm) - probe.apex_mm
        else:
            across, deep = x - self._tangent * (y - self._middle[1]), y + 0 * x
        return (across >= left) & (across <= right) & (deep >= top) & (deep <= bottom)

    def outline(self, probe: Probe, points: int = 17) -> Array:
        """Return the box's edge in the image, (m, 2) mm from the middle of the face, closed."""
        left, right, top, bottom = self.box_mm
        along = np.linspace(left, right, points if probe.curved else 2)
        corners = np.stack([np.append(along, along[::-1]), np.repeat([top, bottom], len(along))], axis=1)
        corners = np.concatenate([corners, corners[:1]])
        across, deep = corners.T
        if probe.curved:
            reach = probe.apex_mm + deep
            angle = across / probe.apex_mm
            return np.stack([reach * np.sin(angle), reach * np.cos(angle) - probe.apex_mm], axis=1)
        return np.stack([across + self._tangent * (deep - self._middle[1]), deep], axis=1)

    @property
    def _middle(self) -> tuple[float, float]:
        left, right, top, bottom = self.box_mm
        return (left + right) / 2, (top + bottom) / 2

    @property
    def _tangent(self) -> float:
        return float(np.tan(np.radians(self.steer_deg)))

    @property
    def _lead(self) -> float:
        """Of steered beams outside the face, so that each begins there, mm."""
        left, right, _, _ = self.box_mm
        return (right - left) / 2 * abs(float(np.sin(np.radians(self.steer_deg))))

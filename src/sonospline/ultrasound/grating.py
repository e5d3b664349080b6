"""Grating lobes: what elements further apart than half a wavelength hear from one direction on either side.

Levels and angles are those of SIMUS, which sums the waves of every element of Verasonics' arrays: a point is heard
47 dB below itself at 31 degrees (L11-5v, F/2, 20 mm deep) and 50 dB at 44 (C5-2v, F/2.5, 60 mm), smeared over 1 to
2 mm. That is three quarters of the angle of the centre frequency: higher ones come from nearer, and elements hear less
from the side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .probe import Probe

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_PITCH_MM, _CURVED_PITCH_MM = 0.3, 0.508
"""Between elements of a straight and of a convex face, of L11-5v and C5-2v."""
_OF_ANGLE = 0.75


def angle(probe: Probe) -> float | None:
    """Return the angle from the beam that grating lobes are heard from, in radians; None where there are none."""
    if probe.kind == "phased":  # made so that there are none, whatever its frequency
        return None
    sine = probe.wavelength_mm / (_CURVED_PITCH_MM if probe.curved else _PITCH_MM)
    return _OF_ANGLE * float(np.arcsin(sine)) if sine < 1 else None


class GratingLobes:
    """Where each run of samples of a probe hears from, in runs of a wide beam of it."""

    def __init__(self, probe: Probe, wide: Probe, run: int, angle: float, level_db: float) -> None:
        self._run, self._runs = run, wide.samples // run
        reach = (np.arange(self._runs) + 0.5) * run * wide.sample_mm
        r, line = wide.range_and_line(reach * np.sin(angle), reach * np.cos(angle))
        own, aside = np.arange(wide.lines)[:, None], line - (wide.lines - 1) / 2
        at = np.stack([own + aside, own - aside])
        low = np.floor(at).astype(int)
        inside = (low >= 0) & (low < wide.lines - 1)
        self._from = np.where(inside, low, 0) * self._runs + (r / wide.sample_mm / run).astype(int)
        level = 10 ** (level_db / 10) / run
        self._shares = (level * inside * np.stack([1 - (at - low), at - low])).astype(np.float32)
        each = np.arange(probe.lines) * (wide.lines - 1) / (probe.lines - 1)
        self._mixed = np.maximum(0, 1 - np.abs(each[:, None] - np.arange(wide.lines))).astype(np.float32)

    def heard(self, beams: Floats) -> Floats:
        """Return their power (lines, runs), of the wide beams (lines, samples, 2)."""
        runs = beams.reshape(-1, 2 * self._run)
        power = np.einsum("ij,ij->i", runs, runs)
        near, beside = (power.take(self._from + further, mode="clip") for further in (0, self._runs))
        found: Floats = self._mixed @ (self._shares[0] * near + self._shares[1] * beside).sum(axis=0)
        return found

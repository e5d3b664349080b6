"""The needle's echoes and its shadow, as the synthesis takes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry import pose
from ..geometry.needle import Needle
from .needle_echo import NeedleEcho
from .optics import CUT_WEIGHT, ELEVATION_CUT, Optics

Array = NDArray[np.float64]

POINT_MM = 0.12
_COPIES = 8
_COPY_FACTOR = 0.62
_COPY_WIDTH_DEG = 12.0
_JITTER = 0.18
SHADOW_SOFT_MM = 0.5
_SHADOW_LINES = 1.5


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

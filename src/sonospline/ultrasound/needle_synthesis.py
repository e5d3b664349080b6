"""The needle's echoes and its shadow, as the synthesis takes them: of a ruled line, or of a shaft as one sees it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..geometry import pose
from ..geometry.bent_needle import BentNeedle
from ..geometry.needle import Needle
from .needle_echo import NeedleEcho
from .optics import CUT_WEIGHT, ELEVATION_CUT, Optics

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

POINT_MM = 0.12
_COPIES = 8
_COPY_FACTOR = 0.62
_COPY_WIDTH_DEG = 12.0
_JITTER = 0.18
SHADOW_SOFT_MM = 0.5
_SHADOW_LINES = 1.5

# Of a real shaft; all set by eye.
_COMET_COPIES, _COMET_FACTOR = 18, 0.78
_FAINTEST = 1e-3  # copy of what it repeats, that is left out
_SPECKLE, _SPECKLE_MM = 0.35, 0.9
_LONGEST_MM = 400.0
_GAPS_MM, _GAP_MM, _GAP_LEFT = 11.0, 1.3, 0.12  # one in so many mm, half as wide as this, with so much left
_BEVEL_DIAMETERS = 2.4
_BEVEL_DB, _FACE_DB = (-1.0, -3.0), 7.0  # its point and its heel; its face below the point
_REAL_SHADOW_LINES = 3.0


def echo(
    model: NeedleEcho,
    needle: Needle | BentNeedle,
    optics: Optics,
    transform: Array,
    seed: int = 0,
    *,
    real: bool = False,
) -> tuple[Floats, Floats]:
    """Return a needle's echoes (m, 4): line, half-sample, real and imaginary part; and its shadow (2, lines).

    Echoes have one phase all along: with the carrier's, the beam would cancel an oblique line. The shadow is
    the range where it begins, and the amplitude left below. A real shaft has speckle and drop-outs, fixed to it, of
    the same mean power; a bevel with two echoes; a comet tail; and keeps more from what lies below.
    """
    probe = optics.probe
    places = np.linspace(0, 1, max(2, int(needle.depth / POINT_MM) + 1))
    shaft = needle.at(places)
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
    beams = probe.beam_directions(points)
    if isinstance(needle, BentNeedle):
        sine = np.abs((beams * (needle.directions(places) @ transform[:3, :3])).sum(axis=1))
    else:
        sine = np.abs(beams @ (transform[:3, :3].T @ needle.direction))
    beta = np.degrees(np.arcsin(np.clip(sine, 0, 1)))
    rms = np.sqrt(optics.power_at(r))
    # one point's share of a line that is as bright as wanted: the beam sees sqrt(2 pi) s_along of it
    along = 1 / np.sqrt((1 - sine**2) / probe.lateral_sigma(r) ** 2 + sine**2 / probe.axial_sigma**2)
    step = needle.depth / (len(shaft) - 1)
    level, heel = model.shaft_db(beta), max(0, len(shaft) - 1 - round(_BEVEL_DIAMETERS * model.diameter_mm / step))
    if real:  # a bevel is ground, and seen from more sides
        level[heel:] = np.maximum(level[heel:], model.tip_db(beta[heel:]) - _FACE_DB)
    amplitude = (10 ** (level / 20) - 1) * rms * step / (np.sqrt(2 * np.pi) * along)
    amplitude *= (_uneven if real else _jitter)(len(shaft), step, seed) * profile
    ring = np.exp(-((beta / _COPY_WIDTH_DEG) ** 2) / 2)
    count, factor = (_COMET_COPIES, _COMET_FACTOR) if real else (_COPIES, _COPY_FACTOR)
    copies = np.arange(count + 1)
    strength = np.where(copies[:, None] == 0, 1.0, ring * factor ** copies[:, None]) * amplitude
    ends, levels = ([-1, heel], _BEVEL_DB) if real else ([-1], (0.0,))
    tip = (10 ** (model.tip_db(beta[-1]) / 20) * rms * profile * seen)[ends] * 10 ** (np.array(levels) / 20)
    copy, at = np.nonzero((strength > (_FAINTEST * amplitude if real else -1)) & seen)
    echoes = np.zeros((len(at) + len(ends), 4), np.float32)
    echoes[:, 0] = np.append(line[at], line[ends])
    echoes[:, 1] = np.append(r[at] + copy * model.reverberation_mm, r[ends]) / optics.half_sample_mm
    echoes[:, 2] = np.append(strength[copy, at], tip)
    return echoes, _shadow(model, r[seen], line[seen], elevation[seen], sigma[seen], probe.lines, no_shadow, real)


def _shadow(
    model: NeedleEcho, r: Array, line: Array, elevation: Array, sigma: Array, lines: int, none: Floats, real: bool
) -> Floats:
    """Where the shadow begins on each line, and the amplitude left, softened across lines."""
    from scipy.ndimage import gaussian_filter1d

    shadow = none.copy()
    number = np.rint(line).astype(int)
    held = (number >= 0) & (number < lines)
    begins = np.full(lines, np.inf)
    np.minimum.at(begins, number[held], r[held])
    covered = np.ones(lines)
    np.minimum.at(covered, number[held], model.shaded(elevation, sigma, real=real)[held])
    met = np.flatnonzero(np.isfinite(begins))
    if len(met):
        every = np.arange(lines)
        shadow[0] = np.interp(every, met, begins[met]) + model.diameter_mm
        between = (every >= met[0]) & (every <= met[-1])
        left = np.where(between, np.interp(every, met, covered[met]), 1.0)
        shadow[1] = gaussian_filter1d(left, _REAL_SHADOW_LINES if real else _SHADOW_LINES, mode="nearest")
    return shadow


def _jitter(count: int, step_mm: float, seed: int) -> Array:
    """A slow log-normal ripple along the shaft, fixed to its tip's end."""
    from scipy.ndimage import gaussian_filter1d

    width = max(1.0, 1.5 / step_mm)
    noise = gaussian_filter1d(np.random.default_rng(seed).standard_normal(count + int(8 * width)), width)[:count]
    return np.exp(_JITTER * noise / max(float(noise.std()), 1e-9))


def _uneven(count: int, step_mm: float, seed: int) -> Array:
    """Speckle and drop-outs along a shaft, from its tip back, of mean power 1."""
    from_tip, uneven = _uneven_shaft(seed)
    return np.interp(np.arange(count) * step_mm, from_tip, uneven)[::-1]


@lru_cache(maxsize=4)
def _uneven_shaft(seed: int) -> tuple[Array, Array]:
    """Places along the longest needle, mm from its tip, and the amplitude there: what is drawn stays with the shaft."""
    from scipy.ndimage import gaussian_filter1d

    random = np.random.default_rng([seed, 18])
    from_tip = np.arange(0, _LONGEST_MM, POINT_MM)
    speckle = gaussian_filter1d(random.standard_normal(len(from_tip)), _SPECKLE_MM / POINT_MM)
    gaps = random.uniform(0, from_tip[-1], int(from_tip[-1] / _GAPS_MM))
    apart = np.abs(from_tip[:, None] - gaps).min(axis=1)
    left = 1 - (1 - _GAP_LEFT) * np.exp(-0.5 * (apart / (_GAP_MM / 2)) ** 2)
    uneven = np.exp(_SPECKLE * speckle / speckle.std()) * left
    return from_tip, uneven / np.sqrt(np.mean(uneven**2))

"""NumPy twin of what is heard beside the beam: a wide, weak beam, haze under the face, and reverberation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .checks import require

Floats = NDArray[np.float32]
Beams = NDArray[np.complex64]

_RUN, _MOST_REPEATS = 16, 4


def require_clutter(
    lines: int,
    samples: int,
    wide: Floats,
    wide_scale: Floats,
    haze: Floats,
    texture: Floats,
    tail_level: float,
    tail_keep: float,
    ghosts: Floats,
    unit: Floats,
    loudness: Floats,
    again: float,
) -> None:
    """Raise where an argument does not go with the beams."""
    require(
        len(wide) == 0 or (len(wide) >= 2 and wide.shape[1] == samples == len(wide_scale)),
        "wide is not (2 or more lines, samples, 2), or wide_scale not (samples)",
    )
    fits = len(haze) == 0 or (len(haze) == lines and haze.shape[1] <= samples)
    require(fits, "haze is not (lines, at most samples, 2)")
    require(len(texture) == 0 or texture.shape[:2] == (lines, samples), "texture is not (lines, samples, 2)")
    require(tail_level >= 0 and 0 <= tail_keep < 1, "tail_level is below 0, or tail_keep not 0 to 1")
    require(len(ghosts) == 0 or ghosts.shape == (lines, samples // _RUN), "ghosts is not (lines, samples / 16)")
    heard = again == 0 or (again > 0 and len(unit) == samples == len(loudness))
    require(heard, "again is below 0, or unit or loudness not (samples)")


def add_clutter(
    beams: Beams,
    wide: Floats,
    wide_scale: Floats,
    haze: Floats,
    texture: Floats,
    tail_level: float,
    tail_keep: float,
    ghosts: Floats,
    unit: Floats,
    loudness: Floats,
    again: float,
) -> Beams:
    """Return beams (lines, samples) with what is heard beside them."""
    if again > 0:
        beams = np.stack([_repeat(line, unit, loudness, again) for line in beams])
    if len(wide):
        at = np.arange(len(beams), dtype=np.float32) * np.float32(len(wide) - 1) / np.float32(len(beams) - 1)
        low = np.minimum(at.astype(int), len(wide) - 2)
        rows = wide[..., 0] + 1j * wide[..., 1]
        beams = beams + wide_scale * (rows[low] + (at - low)[:, None] * (rows[low + 1] - rows[low]))
    if len(texture):
        beams = beams + _tail(beams, tail_level, tail_keep, ghosts) * (texture[..., 0] + 1j * texture[..., 1])
    if len(haze):
        beams = beams.copy()
        beams[:, : haze.shape[1]] += haze[..., 0] + 1j * haze[..., 1]
    return beams.astype(np.complex64)


def _repeat(line: Beams, unit: Floats, loudness: Floats, again: float) -> Beams:
    """Echoes of a line from what is loud in it, again and again: what is largest of three runs, and 4 at most."""
    half = -(-len(line) // (2 * _RUN))  # runs: what lies deeper comes again beyond the last sample
    near = slice(_RUN * (half + 1))
    over = (np.square(line[near].real) + np.square(line[near].imag)) * loudness[near]
    over[:_RUN] = 0
    runs = over.reshape(-1, _RUN)
    most = np.pad(runs.max(axis=1), 1)
    found = ((most[1:-1] > 1) & (most[1:-1] >= most[:-2]) & (most[1:-1] > most[2:]))[:half]
    heard = [_RUN * run + int(runs[run].argmax()) for run in np.flatnonzero(found)[:_MOST_REPEATS]]
    sizes = [again / unit[at] * min(1.0, (over[at] - 1) / 3) * line[at] for at in heard]
    out = line.copy()
    for first, size in zip(heard, sizes, strict=True):
        for start in range(first, len(line) - first, first):  # also of what was added: every multiple
            n = np.arange(start, min(start + first, len(line) - first))
            out[n + first] += unit[n + first] / unit[n] * size * out[n]
    return out


def _tail(beams: Beams, level: float, keep: float, more: Floats) -> NDArray[np.floating]:
    """Amplitude of the reverberation (lines, samples): linear from one run of samples to the next."""
    power = np.square(beams.real) + np.square(beams.imag)
    runs = power.reshape(len(beams), -1, _RUN).mean(axis=2)
    fed = np.zeros((len(beams), runs.shape[1] + 1))
    for run in range(runs.shape[1]):
        fed[:, run + 1] = keep * fed[:, run] + runs[:, run]
    fed *= level
    fed[:, 1:] += more if len(more) else 0
    ends = np.sqrt(fed)
    share = np.arange(_RUN) / _RUN
    amplitude = ends[:, :-1, None] + (ends[:, 1:, None] - ends[:, :-1, None]) * share
    return np.asarray(amplitude.reshape(beams.shape), np.float32)

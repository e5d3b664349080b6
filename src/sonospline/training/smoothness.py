"""How smooth a motion is, whatever the rate at which it was sampled: spectral arc length, and dimensionless jerk.

Balasubramanian et al., J. NeuroEng. Rehab. 12 (2015) 112: both are without unit, do not depend on how long or how far a
motion goes, and are nearer to zero for a smoother one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from .._shown import shown

Array = NDArray[np.float64]

RATE_HZ = 60.0
"""That motions are resampled at."""
_PADDED, _HIGHEST_HZ, _FAINTEST = 4, 10.0, 0.05
"""Doublings of the spectrum's length; its highest frequency; its share of the peak from which on it counts."""
_ROUNDING = 64 * np.finfo(float).eps
"""Of the largest coordinate: what splines leave of places that should be the same, or evenly apart."""


def resampled(time_s: ArrayLike, places: ArrayLike) -> tuple[Array, Array]:
    """Return times a sixtieth of a second apart, and the places (n, d) then, by a cubic spline through those given."""
    time, given = np.asarray(time_s, float), np.asarray(places, float)
    if time.ndim != 1 or len(time) < 2 or not (np.diff(time) > 0).all() or given.shape[:1] != time.shape:
        raise ValueError(f"time_s = {shown(time_s)} does not grow with each place; give two places at least, in order")
    even = np.arange(time[0], time[-1], 1 / RATE_HZ)
    return even, CubicSpline(time, given.reshape(len(time), -1))(even)


def spectral_arc_length(time_s: ArrayLike, places: ArrayLike) -> float:
    """Return the spectral arc length (SPARC) of a motion's speed: -1.4 for one smooth reach, lower for a jerky one.

    Parameters
    ----------
    time_s : (n,) array_like
        Seconds.
    places : (n,) or (n, d) array_like
        Where the tool is.

    Returns
    -------
    float
        NaN for what does not move, or is over in less than four samples of 60 a second.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0, 1, 200)
    >>> reach = 10 * t**3 - 15 * t**4 + 6 * t**5
    >>> tremor = reach + 0.01 * np.sin(2 * np.pi * 8 * t)
    >>> round(spectral_arc_length(t, reach), 2), bool(spectral_arc_length(t, tremor) < -1.6)
    (-1.4, True)
    """
    speed = _speed(time_s, places)
    if speed is None:
        return float("nan")
    count = 2 ** (int(np.ceil(np.log2(len(speed)))) + _PADDED)
    frequency = np.arange(count) * RATE_HZ / count
    spectrum = np.abs(np.fft.fft(speed, count))
    spectrum /= spectrum.max()
    low = frequency <= _HIGHEST_HZ
    frequency, spectrum = frequency[low], spectrum[low]
    heard = np.flatnonzero(spectrum >= _FAINTEST)
    frequency, spectrum = frequency[heard[0] : heard[-1] + 1], spectrum[heard[0] : heard[-1] + 1]
    span = frequency[-1] - frequency[0]
    if span == 0:
        return float("nan")
    return float(-np.hypot(np.diff(frequency) / span, np.diff(spectrum)).sum())


def log_dimensionless_jerk(time_s: ArrayLike, places: ArrayLike) -> float:
    """Return minus the logarithm of the squared jerk of a motion, made dimensionless by its length and peak speed.

    Parameters
    ----------
    time_s : (n,) array_like
        Seconds.
    places : (n,) or (n, d) array_like
        Where the tool is.

    Returns
    -------
    float
        NaN for what does not move, is over in less than four samples of 60 a second, or goes on so evenly that its
        jerk is lost in rounding.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0, 1, 200)
    >>> reach = 10 * t**3 - 15 * t**4 + 6 * t**5
    >>> round(log_dimensionless_jerk(t, reach), 1), bool(log_dimensionless_jerk(t, reach**4) < -6)
    (-5.0, True)
    """
    speed = _speed(time_s, places)
    if speed is None:
        return float("nan")
    jerk = np.diff(speed, 2) * RATE_HZ**2
    if np.abs(jerk).max() <= _ROUNDING * np.abs(places).max() * RATE_HZ**3:
        return float("nan")
    seconds = len(speed) / RATE_HZ
    return float(-np.log((jerk**2).sum() / RATE_HZ * seconds**3 / speed.max() ** 2))


def _speed(time_s: ArrayLike, places: ArrayLike) -> Array | None:
    _, even = resampled(time_s, places)
    if len(even) < 4:
        return None
    speed = np.linalg.norm(np.diff(even, axis=0), axis=1) * RATE_HZ
    return speed if speed.max() > _ROUNDING * np.abs(even).max() * RATE_HZ else None

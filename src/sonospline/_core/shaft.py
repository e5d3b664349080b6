"""Points along a shaft, seen along it: what of it each of them stands for, and how much rubs there.

Points lie at lengths ``along`` of the track, evenly apart; it is cut up to a length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def share_of_end(along: Array, cut: float, apart: float) -> Array:
    """Return the share (m,) of each point in the end of the cut, which lies between two of them."""
    share: Array = np.maximum(0.0, 1.0 - np.abs(along - cut) / apart)
    return share


def lengths(along: Array, anchors: Array, cut: float, apart: float) -> Array:
    """Return the length (m,) of the shaft that each point stands for: in the cut, and behind the tip."""
    half = apart / 2
    begin = np.maximum(along - half, 0.0)
    tip = along + anchors
    length: Array = np.minimum(np.maximum(np.minimum(cut, tip), begin), along + half) - begin
    return length


def friction_bounds(
    length: Array, resistance: Array, sliding: NDArray[np.bool_], used: NDArray[np.bool_], reuse: float, speed: float
) -> Array:
    """Return the largest friction (m,) of points that stand for so much: of those that stick the static one.

    Resistance (4, m) is friction per length, static over sliding, friction per length and speed, and the force that
    cuts; in a used track friction is ``reuse`` of that.
    """
    friction = resistance[0] * np.where(used, reuse, 1.0)
    slides = friction + resistance[2] * abs(speed)
    bound: Array = np.where(sliding, slides, np.maximum(friction * resistance[1], slides)) * length
    return bound


def axes_across(axis: Array) -> Array:
    """Return two unit vectors (2, 3) across an axis, by Duff et al., *J. Comput. Graph. Tech.* 6 (2017) 1."""
    x, y, z = axis
    sign = float(np.copysign(1.0, z))
    a, b = -1 / (sign + z), -x * y / (sign + z)
    return np.array([[1 + sign * a * x * x, sign * b, -sign * x], [b, sign + a * y * y, -y]])

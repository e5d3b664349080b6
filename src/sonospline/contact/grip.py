"""How tissue holds a shaft sideways: its points stay where they were beside the axis when the tip cut there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..geometry.needle import Needle
from .track import Track

Array = NDArray[np.float64]

_BOND = 0.1
"""Of a point's own compliance: needle and tissue give way to each other by so much, assumed, as along the needle."""
_SOFT = 0.3
"""Of it, by which a change of a force counts for more than it moves, the bond included: with less, the errors of a
compliance that is all but singular would grow from step to step."""
_NOTHING = 1e-9


def gripped(track: Track, needle: Needle, moved: Array, share: float) -> Track:
    """Return a track whose points in the cut are held beside the axis.

    Parameters
    ----------
    track : Track
        With its axial forces.
    needle : Needle
        Where it is.
    moved : (m, 3) ndarray
        Displacement of the points under the track's forces.
    share : float
        Of the compliance that answers to a change of forces.
    """
    beside = _across(track.places + moved - needle.tip, needle.direction)
    inside = track.lengths > 0
    held = inside & track.held
    offsets = np.where(held[:, None], track.offsets, beside)
    lateral = np.where(held[:, None], _across(track.lateral, needle.direction), 0.0)
    if held.any():
        own = track.compliance.diagonal().reshape(-1, 3).sum(axis=1) / 3
        wanted = (offsets - beside - _BOND * own[:, None] * lateral)[held]
        lateral[held] += _pulling_back(track, held, wanted, needle.direction, share)
    return track.changed(lateral=lateral, offsets=offsets, held=inside)


def stiffness_across(track: Track, axis: Array) -> float:
    """Return the force, in mN for each mm, that it takes to move the points held across an axis, all of them alike."""
    if not track.held.any():
        return 0.0
    beside = _axes_across(axis)[0]
    wanted = np.tile(beside, (int(track.held.sum()), 1))
    return float(_pulling_back(track, track.held, wanted, axis, 1.0).sum(axis=0) @ beside)


def _pulling_back(track: Track, held: NDArray[np.bool_], wanted: Array, axis: Array, share: float) -> Array:
    """The change of the forces (n, 3) across an axis that moves the points held by what is wanted."""
    found: Array = _core.active.forces_across(
        share * track.compliance, _axes_across(axis), held.view(np.uint8), wanted, _SOFT, _NOTHING
    )
    return found


def _across(vectors: Array, direction: Array) -> Array:
    """What of vectors (m, 3) is across a direction."""
    found: Array = vectors - (vectors @ direction)[:, None] * direction
    return found


def _axes_across(direction: Array) -> Array:
    """Two unit vectors (2, 3) across a direction, by Duff et al., *J. Comput. Graph. Tech.* 6 (2017) 1."""
    x, y, z = direction
    sign = float(np.copysign(1.0, z))
    a, b = -1 / (sign + z), -x * y / (sign + z)
    return np.array([[1 + sign * a * x * x, sign * b, -sign * x], [b, sign + a * y * y, -y]])

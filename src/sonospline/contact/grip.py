"""How tissue holds a shaft sideways: its points stay where they were beside the axis when the tip cut there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core.shaft import axes_across
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
    inside = (track.lengths > 0) & ~track.stays
    seen, held = track.places + moved - needle.tip, inside & track.held
    lateral, offsets = _held(track, seen, needle.direction, held, track.offsets, track.lateral, share)
    return track.changed(lateral=lateral, offsets=offsets, held=inside)


def stiffness_across(track: Track, axis: Array) -> float:
    """Return the force, in mN for each mm, that it takes to move the points held across an axis, all of them alike."""
    if not track.held.any():
        return 0.0
    beside, nothing = axes_across(axis)[0], np.zeros((len(track), 3))
    forces, _ = _held(track, nothing, axis, track.held, np.tile(beside, (len(track), 1)), nothing, 1.0)
    return float(forces.sum(axis=0) @ beside)


def _held(
    track: Track, places: Array, axis: Array, held: NDArray[np.bool_], offsets: Array, lateral: Array, share: float
) -> tuple[Array, Array]:
    """Forces (m, 3) across an axis on the points held, and how far beside it (m, 3) all of them are to be."""
    forces, beside = _core.active.held_across(
        track.compliance, places, axis, held.view(np.uint8), offsets, lateral, share, _BOND, _SOFT, _NOTHING
    )
    return forces, beside

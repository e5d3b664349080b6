"""How far a needle in tissue can be turned: until the tissue beside its shaft would tear.

Forces across the shaft follow from the compliance of its points, frozen, as those along it do. What they load tissue
with is their sum smoothed by the width of the load, as the tissue has it: forces that differ from point to point alone
load it little. It turns as long as that is at most what the tissue takes, or no more than it is before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from .events import Held
from .grip import gripped
from .medium import Medium
from .track import Track

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_ROUNDS = 3
"""Of forces and displacement, for a change of forces moves less at once than in the end."""
_HALVINGS = 10
_STILL = 1e-9
"""mm, and of a unit vector: by less a needle does not turn."""


def held(medium: Medium, name: str, track: Track, displacement: Single, start: Needle, end: Needle) -> Held | None:
    """Return what holds a needle that turns from a pose to another; None where it can.

    Parameters
    ----------
    medium : Medium
        The tissue.
    name : str
        Of the needle.
    track : Track
        Of the needle, while its tissue has a displacement.
    displacement : (3, nx, ny, nz) ndarray
        Of the solver's nodes.
    start, end : Needle
        The poses; how deep they are does not matter.
    """
    if not track.held.any() or is_along(start, end):
        return None
    moved, holds = medium.moved(displacement, track.places), _strength(medium, track)

    def loads(share: float) -> Array:
        return _loads(medium, _turned(track, between(start, end, share), moved), holds)

    most = max(1.0, float(loads(0.0).max()))
    if float((last := loads(1.0)).max()) <= most:
        return None
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        found = loads(middle)
        if float(found.max()) <= most:
            low = middle
        else:
            high, last = middle, found
    return Held(name, medium.tissue_at(track.places[int(last.argmax())]), low)


def between(start: Needle, end: Needle, share: float) -> Needle:
    """Return a needle turned by a share of the way from a pose to another, as deep as the other."""
    entry = start.entry + share * (end.entry - start.entry)
    way = start.direction + share * (end.direction - start.direction)
    return Needle(entry, entry + end.depth * way / np.linalg.norm(way))


def loads(medium: Medium, track: Track) -> Array:
    """Return the force per length (m,) across a track's points over what tissue there takes."""
    return _loads(medium, track, _strength(medium, track))


def is_along(start: Needle, end: Needle) -> bool:
    """Return whether a needle moves along its axis alone."""
    axis, way = start.direction, end.entry - start.entry
    beside = way - (way @ axis) * axis
    return bool(np.abs(beside).max() <= _STILL and np.abs(end.direction - axis).max() <= _STILL)


def _turned(track: Track, needle: Needle, moved: Array) -> Track:
    """A track whose points are held beside another axis."""
    found = track
    for _ in range(_ROUNDS):
        change = (found.lateral - track.lateral).ravel()
        found = gripped(found, needle, moved + (track.compliance @ change).reshape(-1, 3), 1.0)
    return found


def _strength(medium: Medium, track: Track) -> Array:
    """What tissue takes (m,) around each point, in the mean over the width of a load; endless amid fluid."""
    near, strength = _near(medium, track), medium.strength(track.places)
    solid = near @ (strength > 0)
    taken: Array = np.where(solid > 0, near @ strength / np.maximum(solid, np.finfo(float).tiny), np.inf)
    return taken


def _loads(medium: Medium, track: Track, holds: Array) -> Array:
    forces = np.linalg.norm(_near(medium, track) @ track.lateral, axis=1)
    shares: Array = np.where(track.lengths > 0, forces / (np.sqrt(2 * np.pi) * medium.width) / holds, 0.0)
    return shares


def _near(medium: Medium, track: Track) -> Array:
    apart = track.along[:, None] - track.along
    near: Array = np.exp(-0.5 * (apart / medium.width) ** 2)
    return near

"""How a track grows: points ahead of the cut, what resists there, and their compliance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from .medium import Medium
from .track import Passage, Track

Array = NDArray[np.float64]
Single = NDArray[np.float32]

APART = 0.7
"""Distance between points, in widths of a load: closer ones tell the tissue nothing more."""
_FIRST = 4
"""Times as many iterations for the first point, whose displacement begins from rest."""
_LEAST = 1e-9
"""mm per mN, that tissue gives way by: beyond a wall that does not move there is nothing that does."""
_EVEN = 0.9
"""Of what a point moves its neighbour by, that the neighbour moves it by at least in even tissue, few iterations on."""
_MEAN = 0.999
"""Of the mean over the width of a load, that it moves its point by at least where nothing keeps that."""
_NONE = np.array([[0.0], [1.0], [0.0]])
"""Friction of a shaft that nothing holds."""
_WITHIN = 1e-6
_FINE = 16
"""Parts of the way between points at which membranes are looked for."""


def begun(medium: Medium, needle: Needle) -> Track:
    """Return the track of a needle that is about to enter."""
    none, nothing = np.empty(0), np.empty((0, 3))
    rest = medium.solver.rest.displacement
    inside = medium.inside((needle.entry + _WITHIN * needle.direction)[None])[0]
    track = Track(
        apart=APART * medium.width, places=nothing, anchors=none, moved=nothing, axial=none, lateral=nothing,
        offsets=nothing, tip=0.0, cut=0.0, compliance=np.empty((0, 0)), columns=np.stack([rest] * 3),
        sliding=none.astype(bool), used=none.astype(bool), held=none.astype(bool), stays=none.astype(bool),
        resistance=np.empty((4, 0)),
        passages=tuple(Passage(0.0, int(number), inward=True) for number in np.flatnonzero(inside)),
    )  # fmt: skip
    for place in (needle.entry, needle.entry + track.apart * needle.direction):
        track, _ = _with_point(medium, track, place, needle, rest)
    return track


def extended(medium: Medium, track: Track, needle: Needle, displacement: Single) -> tuple[Track, Array]:
    """Return a track with points beyond its cut, and the displacement (n, 3) of those that it has more."""
    found = [np.empty((0, 3))]
    while track.along[-1] <= track.cut:
        # The tip cuts straight on: towards the tissue that the axis meets ahead.
        last, axis = track.places[-1], needle.direction
        ahead = medium.undeformed(displacement, (needle.tip + track.apart * axis)[None], last[None])[0]
        way = ahead - last if (ahead - last) @ axis > 0.1 * track.apart else axis
        place = last + track.apart * way / np.linalg.norm(way)
        track, moved = _with_point(medium, track, place, needle, displacement)
        found.append(moved)
    return track, np.vstack(found)


def _with_point(
    medium: Medium, track: Track, place: Array, needle: Needle, displacement: Single
) -> tuple[Track, Array]:
    """The track with a point more, and how far (1, 3) the tissue there has moved."""
    places, m = np.vstack([track.places, place]), len(track)
    count = medium.iterations * (1 if m else _FIRST)
    columns = np.stack(
        [
            medium.answer(place[None], axis[None], start, iterations=count)
            for axis, start in zip(np.eye(3), track.columns, strict=True)
        ]
    )
    # (3, m + 1, 3): by a force along each axis. A force there moves others as one at those would move it, or nearly so:
    # a force is spread over a width, and beside bone what is around a point moves by it while the point hardly does.
    by_last = np.stack([medium.moved(column, places) for column in columns])
    beside = by_last[:, :-1].reshape(3, 3 * m)
    own, work = by_last[:, -1], _work(medium, place, columns)
    own, work = (own + own.T) / 2, (work + work.T) / 2
    resists = np.array(medium.resistance(place[None]))
    stays = bool(np.linalg.eigvalsh(own - _MEAN * work)[0] < 0)
    if stays:  # and bone's resistance is none of the tissue's before it: bone is what a needle stops at
        own, beside = work, np.zeros_like(beside)
        resists = np.vstack([_NONE, track.resistance[3:, -1:] if m else resists[3:]])
    elif m:
        beside = beside * _returned(medium, track, place, beside[:, -3:])
    own = giving_way(own)
    moved = medium.moved(displacement, place[None])
    anchor = float((needle.tip - place - moved[0]) @ needle.direction)
    none = np.zeros((1, 3))
    return track.changed(
        places=places, anchors=np.append(track.anchors, anchor), axial=np.append(track.axial, 0.0),
        moved=np.vstack([track.moved, moved]), lateral=np.vstack([track.lateral, none]),
        offsets=np.vstack([track.offsets, none]),
        compliance=np.block([[track.compliance, beside.T], [beside, own]]), columns=columns,
        sliding=np.append(track.sliding, False), used=np.append(track.used, False), held=np.append(track.held, False),
        resistance=np.hstack([track.resistance, resists]), stays=np.append(track.stays, stays),
        passages=track.passages + _passages(medium, track, places),
    ), moved  # fmt: skip


def giving_way(own: Array) -> Array:
    """A point's own compliance (3, 3), above zero: beside walls and bone few iterations may leave it below."""
    values, axes = np.linalg.eigh(own)
    if values[0] >= _LEAST:
        return own
    given: Array = (axes * np.maximum(values, _LEAST)) @ axes.T
    return given


def _work(medium: Medium, place: Array, columns: Single) -> Array:
    """How far (3, 3) fields move a place along each axis, in the mean over what a load there is spread over."""
    loads = np.stack([medium.nodal(place[None], axis[None]) for axis in np.eye(3)])
    work: Array = np.einsum("aijkl,bijkl->ba", loads, columns, dtype=float)
    return work


def _returned(medium: Medium, track: Track, place: Array, beside: Array) -> float:
    """Share of what a new point's forces move the last one by (3, 3) that the last one's move it by, at least."""
    back = np.stack([medium.moved(column, place[None])[0] for column in track.columns])
    values, axes = np.linalg.eigh((beside + beside.T) / 2)
    shares = np.einsum("ai,ab,bi->i", axes, back, axes) / np.maximum(values, _LEAST)
    return float(np.clip(shares.min() / _EVEN, 0.0, 1.0)) if values[0] > 0 else 0.0


def _passages(medium: Medium, track: Track, places: Array) -> tuple[Passage, ...]:
    """The membranes between the last two points."""
    if len(places) < 2 or not medium.membranes:
        return ()
    parts = np.arange(_FINE + 1) / _FINE
    way = places[-2] + parts[:, None] * (places[-1] - places[-2])
    way[0] += _WITHIN * (places[-1] - places[-2])  # the first point of all is in the skin
    inside = medium.inside(way)
    begin = float(track.along[-1])
    changes = np.argwhere(inside[1:] != inside[:-1])
    return tuple(
        Passage(begin + track.apart * float(parts[part]), int(number), inward=bool(inside[part + 1, number]))
        for part, number in changes
    )

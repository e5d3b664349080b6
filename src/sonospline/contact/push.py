"""A step of a needle in its track: which points stick, which slip, and how far the tip cuts.

Along the needle, with w the displacement of a point, T where the needle would have it and f the force between them,

    w(f) = w0 + C (f - f0),    f in [-q l, q l],    w = T - b f where |f| < q l,

and at the tip f in [0, R]: below R it holds the tissue ahead, at R it cuts. T moves with the needle; where a point
slips, the place of the needle that it is bound to moves. The bond b is small.
Solved by projected Gauss-Seidel: Coulomb's law as complementarity. How much of the shaft a point stands for changes
with where it is: what the tip has newly come past slides along it, and forces are found anew until all of it rubs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..geometry.needle import Needle
from ..mechanics.loads import MILLI
from .events import Left, Punctured
from .grip import gripped
from .laying import extended
from .medium import Medium
from .motion import Answer, Motion
from .track import Passage, Track

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_SWEEPS = 400
_EXACT = 1e-5
"""Of the distance between points, by which the forces leave one beside its place."""
_BOND = 0.1
"""Of a point's own compliance: needle and tissue give way to each other by so much, assumed; at most 0.05 mm in gel.
Forces that differ from point to point alone hardly move tissue: without a bond they would be what chance makes them."""
_SLOW = 0.02
"""Of a point's own compliance: a change of its force counts for more than it moves. A compliance is symmetric, and the
displacement at a point by a force at another is so only to a tenth of a point's own, a fifth beside other tissue."""
_NOTHING = 1e-9
"""mm per mN: tissue beyond a wall that does not move gives way by so much."""
_ENDS = 2e-3
"""Of the distance between points: by less a tip that could cut on does not."""
_GROWN = 0.01
"""Of the friction of a point all along the shaft: by less than that it has come to stand for more of it."""
_FORWARD = 1e-9
"""mN, and the direction of friction where the tip has just come by."""
_MOST_CUTS = 400
_PART = 0.25
"""Of the distance between points, that a needle goes at most before friction and cut are found anew."""


@dataclass(frozen=True)
class Push:
    """A step of one needle in tissue.

    Parameters
    ----------
    medium : Medium
        The tissue.
    name : str
        Of the needle.
    motion : Motion
        The step.
    displacement : (3, nx, ny, nz) ndarray
        Of the solver's nodes before it.
    grip : bool, default: True
        Whether the tissue holds the shaft sideways, too.
    """

    medium: Medium
    name: str
    motion: Motion
    displacement: Single
    grip: bool = True

    def __repr__(self) -> str:
        return f"Push({self.name!r}, {self.motion.travel:.4g} mm, grip={self.grip})"

    def of(self, track: Track, moved: Array, answer: Answer) -> tuple[Track, Array, tuple[object, ...]]:
        """Return a track after the step, where friction is to bring its points (m, 3), and what has happened.

        Parameters
        ----------
        track : Track
            Before the step.
        moved : (m, 3) ndarray
            Displacement of its points before it.
        answer : Answer
            The tissue's to their forces, which predicts the displacement after it.
        """
        events: list[object] = []
        track = self._on_what_is(track, moved)
        count = max(1, int(np.ceil(self.motion.travel / (_PART * track.apart))))
        for part in self.motion.parts(count):
            before, as_before = track, answer
            track, answer, met = self._cut_on(track, part.needle, answer)
            events += met
            if track.broken:
                ends = _tip_along(before, part.last, as_before), _tip_along(track, part.needle, answer)
                events += self._left(track, *ends)
        bounds = self.bounds(track)  # of what the tip has gone back behind there is less
        track = track.changed(axial=np.clip(track.axial, -bounds, bounds))
        if self.grip:
            track = gripped(track, self.motion.needle, answer.to(track, self.motion.needle), answer.share)
        return track, answer.to(_grown(track, bounds), self.motion.needle), tuple(events)

    def _cut_on(self, track: Track, needle: Needle, answer: Answer) -> tuple[Track, Answer, list[object]]:
        """Stick, slip and cut until the tip rests."""
        events: list[object] = []
        for _ in range(_MOST_CUTS):
            limit, membrane = self.limit(track)
            track, ahead = self._balanced(track, needle, limit, answer)
            if track.tip < limit or ahead > -_ENDS * track.apart:
                if self._is_whole(track):
                    break
                continue
            if membrane is not None:
                events.append(self._through(membrane, limit))
                track = track.changed(broken=track.broken + 1)
                continue
            cut = track.cut + min(-ahead, track.apart, _free_way(track))
            track, moved = extended(self.medium, track, needle, cut, self.displacement)
            answer = answer.with_points(moved)
        return track, answer, events

    def limit(self, track: Track) -> tuple[float, Passage | None]:
        """The force under which the tip goes on, and the membrane that it has to break for that."""
        ahead = track.passages[track.broken :]
        cutting = float(track.end @ track.resistance[3])
        if not ahead or ahead[0].at > track.cut + 1e-9:
            return cutting, None
        rupture = self.medium.membranes[ahead[0].membrane].rupture_force(self.motion.speed)
        return max(MILLI * rupture, cutting), ahead[0]

    def _balanced(self, track: Track, needle: Needle, limit: float, answer: Answer) -> tuple[Track, float]:
        """The forces of a pose, anchors of what slips, and how far tissue is ahead of the tip; behind where it cuts."""
        axis, bounds = needle.direction, self.bounds(track)
        new = _new(track, bounds)
        track = track.changed(sliding=track.sliding | new, axial=np.where(new, _FORWARD, track.axial))
        behind = (needle.tip - track.places - answer.to(track, needle)) @ axis
        along = track.compliance_along(axis)
        axial, anchors, tip, ahead = _core.active.stick_slip(
            answer.share * along, behind, track.end, _bond(along), track.anchors, track.axial, track.tip,
            track.sliding.view(np.uint8), bounds, limit, _SLOW, _SWEEPS, _EXACT * track.apart,
        )  # fmt: skip
        used = track.used | ((anchors < -track.apart / 2) & (track.along < track.cut))
        slides = (np.abs(axial) >= bounds) & (bounds > 0)
        return track.changed(axial=axial, tip=tip, anchors=anchors, sliding=slides, used=used), ahead

    def _is_whole(self, track: Track) -> bool:
        """Whether points that slide rub along all of the shaft that they stand for."""
        bounds = self.bounds(track)
        lacks = bounds - np.abs(track.axial) > _GROWN * track.apart * track.resistance[0]
        return not (lacks & (track.sliding | _new(track, bounds))).any()

    def _on_what_is(self, track: Track, moved: Array) -> Track:
        """A track whose sliding points are where the tissue is, which the step before had only predicted."""
        needle = self.motion.last
        there = (needle.tip - track.places - moved) @ needle.direction - self.stretch(track)
        return track.changed(anchors=np.where(track.sliding, there, track.anchors))

    def stretch(self, track: Track) -> Array:
        """Return by how much friction moves each point (m,) along the shaft that it sticks to."""
        return _bond(track.compliance_along(self.motion.last.direction))[:-1] * track.axial

    def compliance(self, track: Track, axis: Array) -> Array:
        """Return that of the points and of the end of the cut (m + 1, m + 1), along an axis, bonds included."""
        along, rows = track.compliance_along(axis), np.vstack([np.eye(len(track)), track.end])
        compliance: Array = rows @ along @ rows.T
        compliance[np.diag_indices_from(compliance)] += _bond(along)
        return compliance

    def bounds(self, track: Track) -> Array:
        """Largest friction of each point; of one that sticks the static one."""
        friction, static, viscous, _ = track.resistance
        friction = friction * np.where(track.used, self.medium.reuse, 1.0)
        sliding = friction + viscous * abs(self.motion.speed or 0.0)
        bound: Array = np.where(track.sliding, sliding, np.maximum(friction * static, sliding)) * track.lengths
        return bound

    def _through(self, passage: Passage, limit: float) -> object:
        name = self.medium.membranes[passage.membrane].name
        return Punctured(self.name, name, limit / MILLI) if passage.inward else Left(self.name, name)

    def _left(self, track: Track, before: float, after: float) -> list[object]:
        """What the tip is pulled back out of, from one place of the track to another."""
        out = [p for p in track.passages[: track.broken] if p.inward and after < p.at <= before]
        return [Left(self.name, self.medium.membranes[passage.membrane].name) for passage in reversed(out)]


def _bond(along: Array) -> Array:
    """By how much a force moves a point (m + 1,) along the shaft that it sticks to; the end of the cut last."""
    return np.append(_BOND * along.diagonal(), 0.0) + _NOTHING


def _new(track: Track, bounds: Array) -> NDArray[np.bool_]:
    """Which points (m,) the tip has come past that it had not reached before."""
    new: NDArray[np.bool_] = (bounds > 0) & (track.axial == 0) & ~track.sliding
    return new


def _grown(track: Track, bounds: Array) -> Track:
    """A track of which the points that slide rub along all of the shaft that they have come to stand for."""
    return track.changed(axial=np.where(track.sliding, np.sign(track.axial) * bounds, track.axial))


def _free_way(track: Track) -> float:
    """Length of the way to the next membrane."""
    ahead = track.passages[track.broken :]
    return ahead[0].at - track.cut if ahead else np.inf


def _tip_along(track: Track, needle: Needle, answer: Answer) -> float:
    """Length of the track at the tip."""
    there = (needle.tip - track.places - answer.to(track, needle)) @ needle.direction
    return track.cut + min(0.0, float(track.end @ there))

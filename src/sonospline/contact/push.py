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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core.shaft import friction_bounds
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
_THERE = 1e-9
"""mm that a tip is before a membrane which it is at."""
_MOST_CUTS = 400
_PART = 0.25
"""Of the distance between points, that a needle goes at most before friction and cut are found anew."""


class _Cut(NamedTuple):
    """What a tip that rests has come to."""

    bounds: Array
    """(m,) of friction."""
    reached: float
    """Length of the track at the tip."""
    events: list[object]


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

    def of(self, track: Track, answer: Answer) -> tuple[Track, Array, tuple[object, ...]]:
        """Return a track after the step, where friction is to bring its points (m, 3), and what has happened.

        Parameters
        ----------
        track : Track
            Before the step.
        answer : Answer
            The tissue's to their forces, which predicts the displacement after it.
        """
        events: list[object] = []
        track = self._on_what_is(track)
        count = max(1, int(np.ceil(self.motion.travel / (_PART * track.apart))))
        for part in self.motion.parts(count):
            before, as_before = track, answer
            track, answer, cut = self._cut_on(track, part.needle, answer)
            events += cut.events
            if track.broken and cut.reached < track.cut:
                events += self._left(track, _tip_along(before, part.last, as_before), cut.reached)
        # Of what the tip has gone back behind there is less.
        track = track.changed(axial=np.minimum(np.maximum(track.axial, -cut.bounds), cut.bounds))
        if self.grip:
            track = gripped(track, self.motion.needle, answer.to(track, self.motion.needle), answer.share)
        return track, answer.to(_grown(track, cut.bounds), self.motion.needle), tuple(events)

    def _cut_on(self, track: Track, needle: Needle, answer: Answer) -> tuple[Track, Answer, _Cut]:
        """Stick, slip and cut until the tip rests."""
        events: list[object] = []
        for _ in range(_MOST_CUTS):
            membrane, rupture = self._ahead(track)
            along = track.compliance_along(needle.direction)
            behind = (needle.tip - track.places - answer.to(track, needle)) @ needle.direction
            anchors, axial, tip, cut, sliding, used, bounds, reached, breaks = _core.active.cut_on(
                answer.share * along, behind, _bond(along.diagonal()), track.resistance, track.anchors, track.axial,
                track.tip, track.cut, track.sliding.view(np.uint8), track.used.view(np.uint8), track.apart,
                self.medium.reuse, self.motion.speed or 0.0, np.inf if membrane is None else membrane.at, rupture,
                _SLOW, _SWEEPS, _EXACT * track.apart, _ENDS * track.apart, _GROWN, _MOST_CUTS,
            )  # fmt: skip
            state = {"sliding": sliding.view(bool), "used": used.view(bool), "broken": track.broken + breaks}
            track = track.changed(anchors=anchors, axial=axial, tip=tip, cut=cut, **state)
            if breaks and membrane is not None:
                events.append(self._through(membrane, tip))
            elif cut >= track.along[-1]:
                track, moved = extended(self.medium, track, needle, self.displacement)
                answer = answer.with_points(moved)
            else:
                break
        return track, answer, _Cut(bounds, reached, events)

    def _ahead(self, track: Track) -> tuple[Passage | None, float]:
        """The next membrane of a track, if there is one, and the force that it takes to break it."""
        if track.broken == len(track.passages):
            return None, 0.0
        membrane = track.passages[track.broken]
        return membrane, MILLI * self.medium.membranes[membrane.membrane].rupture_force(self.motion.speed)

    def limit(self, track: Track) -> float:
        """Return the force under which the tip goes on: through tissue, or a membrane that it is at."""
        membrane, rupture = self._ahead(track)
        cutting = float(track.end @ track.resistance[3])
        return cutting if membrane is None or membrane.at > track.cut + _THERE else max(rupture, cutting)

    def _on_what_is(self, track: Track) -> Track:
        """A track whose sliding points are where the tissue is, which the step before had only predicted."""
        if not track.sliding.any():
            return track
        needle = self.motion.last
        there = (needle.tip - track.places - track.moved) @ needle.direction - self.stretch(track)
        return track.changed(anchors=np.where(track.sliding, there, track.anchors))

    def stretch(self, track: Track) -> Array:
        """Return by how much friction moves each point (m,) along the shaft that it sticks to."""
        stretch: Array = _bond(track.compliance_along(self.motion.last.direction).diagonal())[:-1] * track.axial
        return stretch

    def compliance(self, track: Track, axis: Array) -> Array:
        """Return that of the points and of the end of the cut (m + 1, m + 1), along an axis, bonds included."""
        along, rows = track.compliance_along(axis), np.vstack([np.eye(len(track)), track.end])
        compliance: Array = rows @ along @ rows.T
        compliance[np.diag_indices_from(compliance)] += _bond(along.diagonal())
        return compliance

    def bounds(self, track: Track) -> Array:
        """Largest friction of each point; of one that sticks the static one."""
        speed = self.motion.speed or 0.0
        return friction_bounds(track.lengths, track.resistance, track.sliding, track.used, self.medium.reuse, speed)

    def _through(self, passage: Passage, force: float) -> object:
        name = self.medium.membranes[passage.membrane].name
        return Punctured(self.name, name, force / MILLI) if passage.inward else Left(self.name, name)

    def _left(self, track: Track, before: float, after: float) -> list[object]:
        """What the tip is pulled back out of, from one place of the track to another."""
        out = [p for p in track.passages[: track.broken] if p.inward and after < p.at <= before]
        return [Left(self.name, self.medium.membranes[passage.membrane].name) for passage in reversed(out)]


def _bond(own: Array) -> Array:
    """By how much a force moves a point (m + 1,) along the shaft that it sticks to; the end of the cut last."""
    return np.append(_BOND * own, 0.0) + _NOTHING


def _grown(track: Track, bounds: Array) -> Track:
    """A track of which the points that slide rub along all of the shaft that they have come to stand for."""
    return track.changed(axial=np.where(track.sliding, np.sign(track.axial) * bounds, track.axial))


def _tip_along(track: Track, needle: Needle, answer: Answer) -> float:
    """Length of the track at the tip."""
    there = (needle.tip - track.places - answer.to(track, needle)) @ needle.direction
    return track.cut + min(0.0, float(track.end @ there))

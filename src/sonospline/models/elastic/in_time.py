"""Needles in elastic tissue, in time: their tracks go on from step to step, and the field answers to their forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...contact.events import Held
from ...contact.laying import begun
from ...contact.medium import Medium
from ...contact.motion import Answer, Motion
from ...contact.push import Push
from ...contact.track import Track
from ...contact.turning import held
from ...elasticity.relaxing import RelaxingSolver
from ...elasticity.state import ElasticState, NotConvergedError, RelaxingState
from ...geometry.needle import Needle
from ...mechanics.loads import MILLI
from ..contract import NeedleForce

Array = NDArray[np.float64]
Single = NDArray[np.float32]

ANEW_MM = 10.0
"""A needle so far beside its track at the skin has been taken out and put in anew."""
_WIDTHS = 3.0
"""Of the load, that needles go at most before the tissue answers anew."""
_LEAST_MM = 0.05
"""Displacement that an error is relative to, at least: between pushing and pulling there is none."""
_LOST = 30.0
"""Error from which on forces and field run away from each other; a shaft that lets go at once changes twice of all."""
_ALIKE, _MOST = 0.5, 5.0
"""Square of the cosine between two changes from which on the next is that much of the last, and times that, at most."""
_ROUGH = 0.3
"""What an iteration leaves of the error of such a guess, at least: that is rougher than others."""
_BEGIN = 1e-6
"""Depth of a needle that is about to enter."""


class Pushed(NamedTuple):
    """Where a step has brought needles and tissue."""

    tissue: RelaxingState
    tracks: dict[str, Track]
    events: tuple[object, ...]
    error: float
    """Of the field, relative, because its forces are not quite those of its own displacement."""
    earlier: Single
    """(3, nx, ny, nz) displacement before its last part."""


@dataclass(frozen=True)
class NeedlesInTime:
    """Steps of needles that remember, in tissue that may.

    Parameters
    ----------
    medium : Medium
        The tissue as needles meet it.
    tissue : RelaxingSolver
        The tissue in time, of the medium's solver.
    tolerance : float
        Error of the field at which a step ends.
    budget : int
        Iterations of a step, at most.
    grip : bool
        Whether tissue holds shafts sideways.
    """

    medium: Medium
    tissue: RelaxingSolver
    tolerance: float
    budget: int
    grip: bool = True

    def step(
        self,
        state: RelaxingState,
        last: Mapping[str, Needle],
        tracks: Mapping[str, Track],
        needles: Mapping[str, Needle],
        dt: float,
        earlier: Single,
    ) -> Pushed:
        """Bring needles to their poses, some time after a state and the displacement before that."""
        ways = {name: self._from(last.get(name), tracks.get(name), needle) for name, needle in needles.items()}
        found = {name: track for name, (_, track) in ways.items()}
        motions = {name: Motion.of(begin, needles[name], dt) for name, (begin, _) in ways.items()}
        pushed = Pushed(state, found, (), 0.0, earlier)
        events: tuple[object, ...] = ()
        parts = self._parts(motions)
        for part in parts:
            pushed = self._step(pushed.tissue, pushed.tracks, part, dt / len(parts), pushed.earlier)
            events += pushed.events
        return pushed._replace(events=events)

    def _step(
        self, state: RelaxingState, begun: dict[str, Track], motions: Mapping[str, Motion], dt: float, earlier: Single
    ) -> Pushed:
        """Move needles, let the tissue answer, and correct what the compliance along the tracks has predicted.

        What a needle has cut, and where it has slipped, stays so: where the prediction was wrong, the needles are moved
        anew from where the step began.
        """
        relaxes = dt > 0 and len(self.tissue.times_s) > 0
        before = state.solution.displacement
        growth = self.tissue.growth(state, dt) if relaxes else 0.0
        # What creeps by no more than fields may err does so everywhere alike: to solve for it takes an iteration.
        ahead = self.tissue.predicted(state, dt).solution.displacement if abs(growth) > self.tolerance else None
        needles = {name: motion.needle for name, motion in motions.items()}
        share = self.tissue.jump(dt) if relaxes else 1.0
        answers = {
            name: Answer(
                (1 + growth) * track.moved if ahead is None else self._moved(ahead, track),
                track.forces(motions[name].last),
                share,
            )
            for name, track in begun.items()
        }
        tracks, predicted, events = self._pushed(begun, motions, before, answers)
        state = self._advanced(self._guess(state, earlier, tracks, predicted), tracks, needles, dt, self.budget)
        taken = state.solution.iterations
        while True:
            now = state.solution.displacement
            tracks = {name: track.changed(moved=self._moved(now, track)) for name, track in tracks.items()}
            error = max((_missed(tracks[name], predicted[name]) for name in needles), default=0.0)
            if error > self.tolerance:
                answers = {name: Answer(track.moved, track.forces(needles[name])) for name, track in tracks.items()}
                anew = {name: track.back_to(begun[name]) for name, track in tracks.items()}
                again, predicted, met = self._pushed(anew, motions, before, answers)
                error = max(_changed(tracks[name], again[name], needle) for name, needle in needles.items())
            if error <= self.tolerance or taken >= self.budget:
                return Pushed(state, tracks, events, _believed(error), before)
            state = self._advanced(state, again, needles, 0.0, self.budget - taken)
            tracks, events, taken = again, met, taken + state.solution.iterations

    def _guess(
        self, state: RelaxingState, earlier: Single, tracks: Mapping[str, Track], predicted: Mapping[str, Array]
    ) -> RelaxingState:
        """A state to iterate from, its displacement carried on as it last went to bring points where they are to be.

        A hand goes on, or back, in much the same way from frame to frame, and so does the field.
        """
        wrong = max((_missed(tracks[name], to) for name, to in predicted.items()), default=0.0)
        if wrong <= self.tolerance or not self.tissue.uniform:
            return state
        last = np.vstack([track.moved - self._moved(earlier, track) for track in tracks.values()]).ravel()
        wanted = np.vstack([to - tracks[name].moved for name, to in predicted.items()]).ravel()
        alike, size = float(last @ wanted), float(last @ last)
        if alike**2 <= _ALIKE * size * float(wanted @ wanted) or abs(alike) > _MOST * size:
            return state
        solution, now = state.solution, state.solution.displacement
        guess, contraction = now + np.float32(alike / size) * (now - earlier), max(solution.contraction, _ROUGH)
        return replace(state, solution=replace(solution, displacement=guess, contraction=contraction))

    def _parts(self, motions: Mapping[str, Motion]) -> list[dict[str, Motion]]:
        """A long way in parts: what the compliance predicts of a field is not the field."""
        longest = max((motion.travel for motion in motions.values()), default=0.0)
        count = max(1, int(np.ceil(longest / (_WIDTHS * self.medium.width))))
        parts = {name: motion.parts(count) for name, motion in motions.items()}
        return [{name: of_needle[part] for name, of_needle in parts.items()} for part in range(count)]

    def held(self, name: str, track: Track | None, now: ElasticState, start: Needle, end: Needle) -> Held | None:
        """Return what keeps a needle from turning from one pose to another."""
        if track is None or not self.grip or np.linalg.norm(end.entry - start.entry) > ANEW_MM:
            return None
        return held(self.medium, name, track, now.displacement, start, end)

    def forces(self, tracks: Mapping[str, Track], needles: Mapping[str, Needle]) -> Single:
        """Return the forces (3, nx, ny, nz) of all needles on the solver's nodes."""
        each = [self.medium.nodal(track.places, track.forces(needles[name])) for name, track in tracks.items()]
        return sum(each[1:], start=each[0])

    def _from(self, last: Needle | None, track: Track | None, needle: Needle) -> tuple[Needle, Track]:
        """Where a needle comes from, and its track: a new one where it has none, or is put in elsewhere."""
        if last is None or track is None or np.linalg.norm(needle.entry - last.entry) > ANEW_MM:
            return Needle(needle.entry, needle.entry + _BEGIN * needle.direction), begun(self.medium, needle)
        return last, track

    def _moved(self, displacement: Single, track: Track) -> Array:
        return self.medium.moved(displacement, track.places)

    def _pushed(
        self, tracks: Mapping[str, Track], motions: Mapping[str, Motion], before: Single, answers: Mapping[str, Answer]
    ) -> tuple[dict[str, Track], dict[str, Array], tuple[object, ...]]:
        """Tracks after motions, from the displacement before and as the tissue answers at their end; where to."""
        found: dict[str, Track] = {}
        predicted: dict[str, Array] = {}
        events: list[object] = []
        for name, track in tracks.items():
            push = Push(self.medium, name, motions[name], before, self.grip)
            found[name], predicted[name], met = push.of(track, answers[name])
            events += met
        return found, predicted, tuple(events)

    def _advanced(
        self, state: RelaxingState, tracks: Mapping[str, Track], needles: Mapping[str, Needle], dt: float, budget: int
    ) -> RelaxingState:
        return self.tissue.advance(state, self.forces(tracks, needles), dt, tolerance=self.tolerance, budget=budget)


def force_of(track: Track, needle: Needle) -> NeedleForce:
    """Return what a needle feels."""
    forces = track.forces(needle) / MILLI
    levers = np.minimum(track.anchors, needle.depth)
    (x, y, z), (a, b, c) = needle.direction.tolist(), (levers @ forces).tolist()
    moment = b * z - c * y, c * x - a * z, a * y - b * x
    return NeedleForce.along(needle.direction, forces.sum(axis=0), moment_nmm=moment)


def _missed(track: Track, predicted: Array) -> float:
    """How far points are from where friction was to bring them: forces found anew change no more than that."""
    least = _LEAST_MM * np.sqrt(len(track))
    return float(np.linalg.norm(track.moved - predicted) / max(float(np.linalg.norm(track.moved)), least))


def _changed(before: Track, after: Track, needle: Needle) -> float:
    """How much of the displacement at a needle's points other forces would change; of one that is next to none, too."""
    new = after.forces(needle)
    old = np.zeros_like(new)
    old[: len(before)] = before.forces(needle)
    moved, changed = after.compliance @ new.ravel(), after.compliance @ (new - old).ravel()
    least = _LEAST_MM * np.sqrt(len(after))
    return float(np.linalg.norm(changed) / max(float(np.linalg.norm(moved)), least))


def _believed(error: float) -> float:
    """The error of a step, where it is one to go on from."""
    if not error < _LOST:
        raise NotConvergedError(
            f"the forces along the needle and the displacement by them are {error:.1g} apart; the last field is kept. "
            "Give shorter steps, a larger budget, or more nodes"
        )
    return error

"""A recording at any of its steps: frames are made again from the nearest one before that is still held."""

from __future__ import annotations

from typing import NamedTuple

from ..simulator.scene import Scene
from ..simulator.session import Session
from ..simulator.simulated_frame import SimulatedFrame
from .recorder import scene_hash
from .recording import Recording, parents, pose_of
from .step import Step, fingerprint

_HELD = 24
"""Frames that are held over a recording, evenly: each has the tissue's whole state, of a megabyte or two."""


class Replayed(NamedTuple):
    """A frame made again."""

    step: Step
    frame: SimulatedFrame
    same: bool
    """Whether every pixel is the recorded one."""

    def __repr__(self) -> str:
        return f"Replayed({self.step!r}, same={self.same})"


class ReplayPlayer:
    """Makes frames of a recording again, in any order.

    Forwards a step costs what it cost at first; backwards those since the last one held are made once more.

    Parameters
    ----------
    recording : Recording
        What was asked of the session.
    scene : Scene
        The scene it was recorded in.

    Raises
    ------
    ValueError
        A scene of another content.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import sonospline as ss
    >>> from sonospline.training import Recorder, Recording, ReplayPlayer
    >>> session = ss.Session("cube", model="kelvinlet")
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "one.mcap"
    >>> with Recorder(path, session.scene) as recorder:
    ...     for depth in (10.0, 20.0, 30.0):
    ...         recorder.add(session.step(needles={"needle": ss.Needle((50, 50, 0), (50, 50, depth))}, dt=1 / 60))
    >>> player = ReplayPlayer(Recording.read(path), session.scene)
    >>> [player.at(place).same for place in (2, 0, 1)]
    [True, True, True]
    """

    def __init__(self, recording: Recording, scene: Scene) -> None:
        if recording.header["scene_hash"] != scene_hash(scene):
            raise ValueError(
                f"scene {scene.spec.name!r} is not the one of the recording, {recording.header['scene']!r}, or was "
                "changed since; give that one"
            )
        self.recording = recording
        self._session, self._before = Session(scene), parents(recording.steps)
        every = max(1, -(-len(recording.steps) // _HELD))
        self._last_use = {parent: at for at, parent in enumerate(self._before) if parent != at - 1}
        self._to_hold = {at for at in range(len(recording.steps)) if at % every == 0}
        self._held: dict[int, SimulatedFrame | None] = {-1: None}
        self._latest = self._pinned = -1

    def at(self, place: int) -> Replayed:
        """Return the frame of a step, by its place in the recording."""
        way, at = [], place
        while at not in self._held:
            way.append(at)
            at = self._before[at]
        for step in reversed(way):
            self._make(step)
        frame, found = self._held[place], self.recording.steps[place]
        assert frame is not None
        return Replayed(found, frame, fingerprint(frame.image.shown) == found.image)

    def pin(self, place: int) -> None:
        """Hold the frame of a place that was just made, until another one is pinned."""
        self._pinned, old = place, self._pinned
        if old != self._latest and not self._is_needed(old, place):
            self._held.pop(old, None)

    def _make(self, place: int) -> None:
        """Make a frame from the one before it, which is held."""
        session, step, before = self._session, self.recording.steps[place], self._before[place]
        session.resume(self._held[before])
        assert step.model is not None and step.target is not None
        session.switch(step.model)
        session.choose_target(step.target, None if step.target in session.targets else step.target_rest)
        needles = {name: recorded.needle for name, recorded in (step.needles or {}).items()}
        self._held[place] = session.step(
            needles=needles, probe_to_reference=pose_of(step), settings=step.settings, tissue=step.tissue, dt=step.dt
        )
        for old in (before, self._latest):
            if old != place and not self._is_needed(old, place):
                self._held.pop(old, None)
        self._latest = place

    def _is_needed(self, old: int, place: int) -> bool:
        """Whether a frame is held on: one of those over the recording, or one that a later branch begins at."""
        return old < 0 or old == self._pinned or old in self._to_hold or self._last_use.get(old, -1) > place

    def __repr__(self) -> str:
        return f"ReplayPlayer({self.recording!r})"

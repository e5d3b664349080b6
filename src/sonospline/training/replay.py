"""Make a recording's frames again, pixel for pixel, and say where they are not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from .. import _core
from ..simulator.scene import Scene
from ..simulator.session import Session
from ..simulator.simulated_frame import SimulatedFrame
from .recorder import scene_hash
from .recording import Recording, parents, pose_of
from .step import Step, fingerprint


class Replayed(NamedTuple):
    """A frame made again."""

    step: Step
    frame: SimulatedFrame
    same: bool
    """Whether every pixel is the recorded one."""

    def __repr__(self) -> str:
        return f"Replayed({self.step!r}, same={self.same})"


def unlike(recording: Recording) -> str:
    """Return why this machine's frames cannot be promised to be the recorded ones; empty where they can."""
    ours = {"backend": _core.backend(), "instruction_set": _core.instruction_set() or ""}
    other = [f"{name} {recording.header.get(name)!r}, not {value!r}" for name, value in ours.items()
             if recording.header.get(name) != value]  # fmt: skip
    return f"recorded with {'; '.join(other)}: frames may differ in last bits" if other else ""


def replay(recording: Recording, scene: Scene) -> Iterator[Replayed]:
    """Make the frames of a recording again, one after the other.

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
    """
    if recording.header["scene_hash"] != scene_hash(scene):
        raise ValueError(
            f"scene {scene.spec.name!r} is not the one of the recording, {recording.header['scene']!r}, or was changed "
            "since; give that one"
        )
    return _replayed(recording, scene)


def _replayed(recording: Recording, scene: Scene) -> Iterator[Replayed]:
    session, before = Session(scene), parents(recording.steps)
    last_use = {parent: at for at, parent in enumerate(before)}
    kept: dict[int, SimulatedFrame | None] = {-1: None}
    for at, step in enumerate(recording.steps):
        session.resume(kept[before[at]])
        assert step.model is not None and step.target is not None
        session.switch(step.model)
        session.choose_target(step.target, None if step.target in session.targets else step.target_rest)
        needles = {name: recorded.needle for name, recorded in (step.needles or {}).items()}
        frame = session.step(
            needles=needles, probe_to_reference=pose_of(step), settings=step.settings, tissue=step.tissue, dt=step.dt
        )
        if at in last_use:
            kept[at] = frame
        if last_use[before[at]] == at and before[at] >= 0:
            del kept[before[at]]
        yield Replayed(step, frame, fingerprint(frame.image.pixels) == step.image)

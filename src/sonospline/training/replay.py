"""Make a recording's frames again, pixel for pixel, and say where they are not."""

from __future__ import annotations

from collections.abc import Iterator

from .. import _core
from ..simulator.scene import Scene
from .recording import Recording
from .replay_player import Replayed, ReplayPlayer


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
    player = ReplayPlayer(recording, scene)
    return (player.at(place) for place in range(len(recording.steps)))

"""A frame as a console shows it: seen from the skin, with the pass it belongs to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .command import Command
from .logged_event import Log
from .pass_metrics import PassMetrics
from .readouts import Blocked, Readouts
from .scene import Scene
from .simulated_frame import SimulatedFrame

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ConsoleFrame(SimulatedFrame):
    """A frame with the command in force. Its read-outs are from the entry while the needle is out."""

    command: Command
    """The command in force: what was asked for, as far as the tissue allows it."""
    blocked: Blocked | None
    """Why the needle is not where it was asked to be, or goes no further."""
    bone: str | None
    """The bone that blocks it, as the label map calls it."""
    held_by: str | None
    """The tissue that holds it, as the label map calls it: it turns no further."""
    entry: Array
    """Where the needle meets the skin, or would."""
    tip: Array
    direction: Array
    metrics: PassMetrics
    """Of the present pass, or the last one."""
    log: Log
    """The last events in words, of frames that nobody saw, too."""


def seen_from_skin(
    frame: SimulatedFrame, scene: Scene, command: Command, *, blocked: Blocked | None = None, bone: str | None = None,
    held_by: str | None = None, metrics: PassMetrics, log: Log = (),
) -> ConsoleFrame:  # fmt: skip
    """Return a frame as a console shows it that has come to a command."""
    entry, direction = scene.frame.entry(command.needle), scene.frame.direction(command.needle)
    readouts = frame.readouts if frame.needles else _from_entry(frame, entry)
    return ConsoleFrame(
        **vars(frame) | {"readouts": replace(readouts, depth=command.needle.depth)}, command=command, blocked=blocked,
        bone=bone, held_by=held_by, entry=entry, tip=entry + command.needle.depth * direction, direction=direction,
        metrics=metrics, log=log,
    )  # fmt: skip


def _from_entry(frame: SimulatedFrame, entry: Array) -> Readouts:
    """The read-outs while the needle is out: from where it would enter."""
    away, half_slice = frame.out_of_plane(entry)
    to_target = float(np.linalg.norm(frame.target_now - entry))
    return replace(frame.readouts, tip_to_target=to_target, out_of_plane=away, half_slice=half_slice)

"""What the tissue allows of a command: how deep the needle can go, and how far one inside can be turned."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from ..fields.field import Field
from .bone_contact import pushed, turned
from .command import Command, NeedleCommand
from .readouts import Blocked
from .scene import Scene
from .skin_frame import room_along

STEER_DEG = 5.0
"""How far a needle inside can be turned from the direction it entered in, where tissue has no say in it."""
MOST_DEG = 20.0
"""How far where tissue has: it ends in most cases before that."""
_OUT_MM = 0.05
"""A needle less deep than this is out."""
_INSIDE_MM = 1e-3
"""Room left between a tip and the far side of the box."""


class Constrained(NamedTuple):
    """A command as far as needle and tissue allow it, and why it goes no further."""

    command: Command
    blocked: Blocked | None
    bone: str | None = None
    """Which, where one is why."""
    held_by: str | None = None
    """Which tissue, where it is why."""


def constrain(
    scene: Scene,
    command: Command,
    entered: NeedleCommand | None,
    before: NeedleCommand | None = None,
    field: Field | None = None,
    *,
    time: bool = True,
) -> Constrained:
    """Return a command as far as needle and tissue allow it.

    Parameters
    ----------
    scene : Scene
        Where it is given.
    command : Command
        What the hand asks for.
    entered : NeedleCommand or None
        How the needle that is inside went in.
    before : NeedleCommand, optional
        Where it is now: it turns from there, as far as no bone is in the way.
    field : Field, optional
        How the tissue has moved, and loose fragments of bone with it.
    time : bool, default: True
        Whether the model knows time: tissue of others is not dented by a probe.
    """
    if not time or command.tissue is None or command.tissue.probe == "looks":
        command = command.with_probe(press=0.0)  # a probe that only looks presses nothing beyond what the scene has it
    needle = command.needle
    if needle.depth < _OUT_MM:
        return Constrained(command.with_needle(depth=0.0), None)
    blocked: Blocked | None = None
    bone: str | None = None
    if entered is not None:
        tracks = time and command.tissue is not None and command.tissue.contact == "track"
        held = _held(needle, entered, MOST_DEG if tracks else STEER_DEG)
        blocked = None if held == needle else "needle inside"
        needle = held
        if before is not None and scene.has_bone:
            needle, bone = turned(scene, before, needle, field)
    frame, length = scene.frame, scene.spec.needle.length_mm
    room = room_along(scene.tissue.grid, frame.entry(needle), frame.direction(needle)) - _INSIDE_MM
    if needle.depth > room:
        needle, blocked = replace(needle, depth=room if room > _OUT_MM else 0.0), "leaves the tissue"
    elif needle.depth >= length:
        needle, blocked = replace(needle, depth=length), "end of needle"
    if scene.has_bone:
        needle, ahead = pushed(scene, needle, field)
        bone = ahead or bone
    if needle.depth < _OUT_MM:
        needle = replace(needle, depth=0.0)
    return Constrained(replace(command, needle=needle), "bone" if bone else blocked, bone)


def _held(command: NeedleCommand, entered: NeedleCommand, most: float) -> NeedleCommand:
    """A needle inside keeps its entry and turns but a little from the direction it entered in."""
    return replace(
        command,
        u=entered.u,
        v=entered.v,
        angle=float(np.clip(command.angle, entered.angle - most, entered.angle + most)),
        swing=float(np.clip(command.swing, entered.swing - most, entered.swing + most)),
    )

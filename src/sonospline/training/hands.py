"""Hands that do an exercise by themselves: an expert and a novice, for tests and as the first expert band."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..simulator.command import Command
from ..simulator.scene import Scene
from .attempt import Attempt, Result

Array = NDArray[np.float64]

_RATES = {
    "depth": 12.0,
    "u": 20.0,
    "v": 20.0,
    "angle": 15.0,
    "swing": 15.0,
    "slide": 20.0,
    "sweep": 20.0,
    "rotate": 25.0,
}
"""How fast a hand moves a knob, mm or degrees a second."""


class Hand(Protocol):
    """What works an attempt."""

    def act(self, attempt: Attempt) -> Command | None:
        """Return where to be now; None to say "I am on target"."""
        ...


def performed(attempt: Attempt, hand: Hand, *, dt: float = 0.1) -> Result:
    """Let a hand do an attempt, at most until its time is up, and return what it came to."""
    attempt.begin()
    while attempt.state == "running":
        wanted = hand.act(attempt)
        if wanted is None:
            return attempt.say_on_target()
        attempt.step(_within_reach(attempt.command, wanted, dt), dt)
    assert attempt.result is not None
    return attempt.result


class Novice:
    """Holds one key, the one that pushes, until it stops or has gone as far as the needle is long."""

    def act(self, attempt: Attempt) -> Command | None:
        """Push on; "on target" when it goes no further."""
        if attempt.frame.blocked:
            return None
        return attempt.command.with_needle(depth=attempt.scene.spec.needle.length_mm)


class Expert:
    """Finds target and entry in one plane, aims at where the target is, pushes, and looks again while it does.

    It knows where the target is, as one does who has found it in the image.

    Parameters
    ----------
    across : bool, default: False
        Whether the image plane is across the needle, through the target, and not along it.
    """

    def __init__(self, *, across: bool = False) -> None:
        self._across = across
        self._still = 0

    def act(self, attempt: Attempt) -> Command | None:
        """Survey, have the breath held, aim, push, wait for the tissue, say so."""
        command, skin, frame = _held(attempt.command), attempt.scene.frame, attempt.frame
        if command.needle.depth == 0:
            command = self._in_zone(attempt, command)
        entry = skin.entry(command.needle)
        target = frame.target_now
        probe = probe_above(attempt.scene, command, entry, target, across=self._across)
        if command.needle.depth == 0 and not _is_at(attempt.command, probe):
            return probe
        away = target - entry
        aimed = skin.needle_command(Needle(entry, entry + away))
        inside = attempt.command.needle.depth
        aim = replace(aimed, depth=inside)
        if inside == 0 and not _is_at(attempt.command, replace(probe, needle=aim)):
            return replace(probe, needle=aim)
        along = float(np.linalg.norm(away))
        self._still = self._still + 1 if abs(along - inside) < 0.4 else 0
        if self._still > 5:
            return None
        return replace(probe, needle=replace(aim, depth=along))

    def _in_zone(self, attempt: Attempt, command: Command) -> Command:
        zone = attempt.exercise.entry_zone
        if zone is None:
            return command
        middle = {"u": sum(zone.u) / 2, "v": sum(zone.v) / 2}
        return replace(command, needle=replace(command.needle, **middle))


def probe_above(scene: Scene, command: Command, entry: Array, target: Array, *, across: bool = False) -> Command:
    """Return a command with the probe above the target, its image along the way there, or across it."""
    skin = scene.frame
    right, _, out = skin.parts(target - skin.origin)
    ahead, _, aside = skin.parts(target - entry)
    turn = np.degrees(np.arctan2(-aside, ahead)) + (90.0 if across else 0.0)
    turn = (turn + 90) % 180 - 90 if not across else turn
    slide, sweep = (
        float(np.clip(at, (knob := scene.knobs[f"probe.{name}"]).low, knob.high))
        for name, at in (("slide", right), ("sweep", out))
    )
    return replace(command, probe=replace(command.probe, rotate=float(turn), fan=0.0, slide=slide, sweep=sweep))


def _held(command: Command) -> Command:
    """A command under which somebody who breathes does not."""
    if command.tissue is None or command.tissue.breathing != "free":
        return command
    return replace(command, tissue=replace(command.tissue, breathing="held"))


def _is_at(now: Command, wanted: Command) -> bool:
    return all(
        abs(getattr(getattr(now, part), knob) - getattr(getattr(wanted, part), knob)) < 1e-6
        for part, knobs in _KNOBS.items()
        for knob in knobs
    )


_KNOBS = {"needle": ("depth", "u", "v", "angle", "swing"), "probe": ("slide", "sweep", "rotate")}


def _within_reach(now: Command, wanted: Command, dt: float) -> Command:
    """A command on the way to another, as far as hands come in a time."""
    parts = {}
    for part, knobs in _KNOBS.items():
        here, there = getattr(now, part), getattr(wanted, part)
        reached = {
            knob: getattr(here, knob)
            + float(np.clip(getattr(there, knob) - getattr(here, knob), -_RATES[knob] * dt, _RATES[knob] * dt))
            for knob in knobs
        }
        parts[part] = replace(there, **reached)
    return replace(wanted, **parts)

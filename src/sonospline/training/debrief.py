"""What an attempt is talked about by: its course on one time axis, what happened when, and where the needle went."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..simulator.skin_frame import SkinFrame
from .attempt import Result
from .attempt_metrics import REVERSAL_MM, advances, is_blind
from .trace import Trace

Array = NDArray[np.float64]
Kind = Literal["skin", "out", "tissue", "blind", "back", "end"]
_MOST = 1500
"""Samples of a course: more than a screen has columns."""
_APART_MM = 1.0
"""Advanced blind, from which on it is worth a word."""


@dataclass(frozen=True)
class Happening:
    """Something that happened in an attempt."""

    time_s: float
    kind: Kind
    text: str
    until_s: float | None = None
    """When it ended, where it lasted."""


@dataclass(frozen=True, eq=False)
class Course:
    """An attempt over its time, of at most 1500 samples; what is not known of one is NaN.

    Lengths in mm; places to the right, deeper and away from the viewer, from where the skin's coordinates begin.
    """

    time_s: Array
    depth: Array
    out_of_plane: Array
    """Towards the viewer is plus, as the page shows it."""
    half_slice: Array
    to_target: Array
    """From the tip to the target where it then was."""
    force: Array
    tip: Array
    entry: Array
    target: Array


def course(trace: Trace, skin: SkinFrame) -> Course:
    """Return the course of a trace; the first and the last sample are in it."""
    n = len(trace.time_s)
    kept = np.unique(np.linspace(0, n - 1, min(n, _MOST)).round().astype(int))

    def places(points: Array) -> Array:
        return np.stack([(points[kept] - skin.origin) @ axis for axis in (skin.right, skin.depth, skin.out)], axis=1)

    return Course(
        time_s=trace.time_s[kept] - trace.time_s[0], depth=np.nan_to_num(trace.depth_mm[kept]),
        out_of_plane=-trace.out_of_plane[kept], half_slice=trace.half_slice[kept],
        to_target=np.linalg.norm(trace.target - trace.tip, axis=1)[kept], force=trace.axial_n[kept],
        tip=places(trace.tip), entry=places(trace.entry), target=places(trace.target),
    )  # fmt: skip


def happenings(result: Result, events: list[tuple[float, str]]) -> tuple[Happening, ...]:
    """Return what happened, in order: the needle in and out, blind stretches, turns, what tissue said, and the end."""
    trace = result.trace
    found = [Happening(time, "tissue", text) for time, text in events]
    for number, samples in enumerate(trace.passes, 1):
        found.append(Happening(float(trace.time_s[samples.start]), "skin", "skin" if number == 1 else f"pass {number}"))
        if samples.stop < len(trace.time_s):
            found.append(Happening(float(trace.time_s[samples.stop]), "out", "out"))
        found += _turns(trace, samples)
    found += [
        Happening(float(trace.time_s[a]), "blind", f"blind for {advance:.0f} mm", float(trace.time_s[b]))
        for a, b, advance in blind_stretches(trace)
        if advance > _APART_MM
    ]
    said = "“on target”" if result.ended == "on target" else result.ended
    found.append(Happening(float(trace.time_s[-1]), "end", said))
    began = float(trace.time_s[0])
    ordered = sorted(found, key=lambda one: one.time_s)
    return tuple(
        replace(one, time_s=one.time_s - began, until_s=None if one.until_s is None else one.until_s - began)
        for one in ordered
    )


def blind_stretches(trace: Trace) -> list[tuple[int, int, float]]:
    """Return the stretches over which the needle went on blindly, pauses and all: first and last sample, and mm."""
    found: list[tuple[int, int, float]] = []
    blind = is_blind(trace)
    for samples, advance in advances(trace):
        places = np.flatnonzero(blind[samples] & (advance >= 0))
        for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1):
            if run.size:
                a, b = samples.start + int(run[0]), samples.start + int(run[-1])
                found.append((a, b, float(advance[run].sum())))
    return found


def _turns(trace: Trace, samples: slice) -> list[Happening]:
    """Where a needle that is in began to be pulled back by more than the hysteresis of a redirection."""
    depth, found, deepest = trace.depth_mm[samples], [], 0
    for at, now in enumerate(depth):
        if deepest >= 0 and now > depth[deepest]:
            deepest = at
        if deepest >= 0 and now < depth[deepest] - REVERSAL_MM:
            time = float(trace.time_s[samples.start + deepest])
            found.append(Happening(time, "back", "turned back"))
            deepest = -1
        elif deepest < 0 and now > depth[at - 1]:
            deepest = at
    return found


def story(result: Result, course: Course, happened: tuple[Happening, ...]) -> tuple[str, ...]:
    """Return an attempt in a few sentences, made of what happened."""
    metrics, trace = result.metrics, result.trace
    if not trace.passes:
        return ("The needle was not put in.",)
    said = [f"The needle went in after {metrics['time_to_skin_s']:.1f} s{_beside(result.exercise.entry_zone, course)}."]
    blind = [one for one in happened if one.kind == "blind"]
    if blind:
        said.append(f"It was advanced with its tip out of the image, {metrics['blind_advance_mm']:.0f} mm in all.")
    turns = int(metrics["redirections"])
    if turns:
        said.append(f"It was redirected {'once' if turns == 1 else f'{turns} times'}.")
    moved = metrics["target_motion_mm"]
    said.append(
        f"At last its tip was {metrics['final_error_mm']:.1f} mm from the target, which had moved {moved:.1f} mm."
    )
    return tuple(said)


def _beside(zone: Any, course: Course) -> str:
    """How far from the middle of its zone the needle entered."""
    inside = np.flatnonzero(np.isfinite(course.entry[:, 0]))
    if zone is None or not inside.size:
        return ""
    entry = course.entry[inside[0]]
    u, v = entry[0] - sum(zone.u) / 2, entry[2] - sum(zone.v) / 2
    return f", {np.hypot(u, v):.0f} mm from the middle of its zone"

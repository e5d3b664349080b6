"""How a station stands, in the numbers and the word that the trainer reads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .trainer_messages import State, StationState

if TYPE_CHECKING:
    from ..training.exercise import Exercise
    from .station import Seen, Station

BLIND_MM = 8.0
"""Advance with the tip out of plane that is said where an exercise does not say how much is enough."""


def state_of(station: Station) -> StationState:
    """Return what the trainer sees of a station."""
    attempt, seen = station.attempt, station.seen
    state = _state(station)
    result = None if attempt is None else attempt.attempt.result
    task = None if attempt is None else attempt.attempt.exercise
    word, caution = _word(station, state, task)
    summary = None if seen is None else seen.summary
    return StationState(
        name=station.name, participant=station.participant, state=state, exercise=None if task is None else task.name,
        exercise_set=station.exercise_set, guides_locked=station.guides_locked, models_locked=station.models_locked,
        hands_locked=station.hands_locked,
        word=word, caution=caution, time_s=0.0 if summary is None else round(summary.time_s, 1),
        limit_s=None if task is None else task.time_limit_s, passes=0 if summary is None else summary.passes,
        **_readouts(seen), blind_mm=_known(_blind(station)),
        verdict="" if result is None else result.verdict, said=station.said,
        comments=tuple(station.comments), frame=0 if seen is None else seen.frame,
    )  # fmt: skip


def _readouts(seen: Seen | None) -> dict[str, float | None]:
    """The numbers beside the picture, whatever the exercise shows of them."""
    if seen is None:
        return dict.fromkeys(("to_target_mm", "out_of_plane_mm", "half_slice_mm", "depth_mm", "force_n"))
    found = seen.shown.readouts
    return {
        "to_target_mm": _known(found.tip_to_target), "out_of_plane_mm": _known(-found.out_of_plane),
        "half_slice_mm": _known(found.half_slice), "depth_mm": _known(found.depth),
        "force_n": None if found.hub is None else _known(found.hub.axial_n),
    }  # fmt: skip


def _state(station: Station) -> State:
    if station.connection is None:
        return "empty"
    if station.participant is None:
        return "no code"
    if station.working is None:
        return "loading"
    if station.attempt is None:
        return "practice"
    return "debrief" if station.attempt.over else "running"


def _word(station: Station, state: State, task: Exercise | None) -> tuple[str, bool]:
    """A word or two, and whether the trainer should look."""
    seen, attempt = station.seen, station.attempt
    if station.hands_locked and state in ("practice", "running"):
        return "frozen", False
    if state == "debrief" and attempt is not None and attempt.attempt.result is not None:
        return ("passed", False) if attempt.attempt.result.passed else ("not yet", True)
    if state != "running" or seen is None or task is None:
        return state, False
    blind, mark = _blind(station), task.pass_mark.get("blind_advance_mm")
    enough = BLIND_MM if mark is None or mark.most is None else mark.most
    if seen.shown.bone is not None:
        return f"{seen.shown.bone} touched", True
    if blind is not None and blind > enough:
        return f"{blind:.0f} mm blind", True
    return ("on target", False) if _on_target(seen, station) else ("running", False)


def _on_target(seen: Seen, station: Station) -> bool:
    scene = None if station.working is None else station.working[1].scene
    if scene is None or seen.shown.readouts.depth <= 0:
        return False
    return seen.shown.readouts.tip_to_target <= scene.spec.display.tolerance_mm


def _blind(station: Station) -> float | None:
    """Advance with the tip out of plane; in a debrief that of the whole attempt."""
    attempt = station.attempt
    result = None if attempt is None else attempt.attempt.result
    if result is not None:
        return result.metrics["blind_advance_mm"]
    return None if station.seen is None else station.seen.summary.blind_mm


def _known(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(float(value), 2)

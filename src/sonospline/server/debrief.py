"""What a page is told of an attempt that is over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..training.attempt import Result
from ..training.band import Band, band_made_by, shipped_band
from ..training.debrief import Course, course, happenings, story
from ..training.metric import METRICS
from ..training.replay import unlike
from ..training.replay_player import ReplayPlayer
from . import server_messages as said
from .exercise_catalog import offered
from .live_attempt import LiveAttempt

_DIGITS = 3
"""Behind the point of a course's numbers: micrometres."""


def player_of(attempt: LiveAttempt) -> tuple[ReplayPlayer | None, str]:
    """Return who makes an attempt's pictures again from its file, and what is to be said of that."""
    recording = attempt.recording.read()
    if recording is None:
        return None, attempt.recording.problem
    return ReplayPlayer(recording, attempt.console.scene), attempt.recording.problem or unlike(recording)


def debrief_of(attempt: LiveAttempt, player: ReplayPlayer | None, problem: str) -> said.Debrief:
    """Return what an attempt came to."""
    result = attempt.attempt.result
    assert result is not None
    over_time = course(result.trace, attempt.console.scene.frame)
    happened = happenings(result, attempt.events)
    bands = shipped_band(attempt.exercise)
    return said.Debrief(
        exercise=offered(attempt.exercise, result.exercise), seed=result.seed, ended=result.ended,
        passed=result.passed,
        story=story(result, over_time, happened),
        metrics=tuple(_measured(name, result, bands.get(name)) for name in METRICS),
        band=band_made_by() if bands else "",
        happened=tuple(said.Happened(**vars(one)) for one in happened),
        course=_over_time(over_time, player), steps=0 if player is None else len(player.recording.steps),
        problem=problem,
    )  # fmt: skip


def _measured(name: str, result: Result, band: Band | None) -> said.MeasuredMetric:
    metric, value = METRICS[name], result.metrics[name]
    judged = next((mark for mark in result.marks if mark.metric == name), None)
    return said.MeasuredMetric(
        name=name, unit=metric.unit, better=metric.better, definition=metric.definition, source=metric.source,
        value=_known(value), least=None if judged is None else judged.mark.least,
        most=None if judged is None else judged.mark.most, passed=None if judged is None else judged.passed,
        band=None if band is None else said.ExpertBand(**vars(band)),
        z=None if band is None else _known(band.z(value)),
    )  # fmt: skip


def _over_time(found: Course, player: ReplayPlayer | None) -> said.Course:
    steps = np.zeros(len(found.time_s), int)
    if player is not None:
        times = np.array([step.time_s for step in player.recording.steps])
        steps = np.searchsorted(times - times[0], found.time_s + 1e-9, side="right") - 1
    return said.Course(
        time_s=_column(found.time_s), depth=_column(found.depth), out_of_plane=_column(found.out_of_plane),
        half_slice=_column(found.half_slice), to_target=_column(found.to_target), force=_column(found.force),
        tip=_places(found.tip), entry=_places(found.entry), target=_places(found.target), step=tuple(steps.tolist()),
    )  # fmt: skip


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _column(values: Any) -> Any:
    return tuple(round(value, _DIGITS) if math.isfinite(value) else None for value in values.tolist())


def _places(points: Any) -> Any:
    rounded = np.round(points, _DIGITS).tolist()
    return tuple(tuple(point) if math.isfinite(point[0]) else None for point in rounded)

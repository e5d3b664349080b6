"""What an attempt is talked about by: bands, happenings and sentences, on traces whose answers are known."""

import json
import math
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonospline.simulator.skin_frame import SkinFrame
from sonospline.training import METRICS, SHIPPED_EXERCISES, Band, Exercise, Task, Trace, measure, shipped_band
from sonospline.training.debrief import blind_stretches, course, happenings, story

NUMBERS = st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30)


@given(NUMBERS)
def test_a_band_is_the_mean_and_the_sample_deviation(values):
    band = Band.of(values)
    assert band.mean == pytest.approx(np.mean(values), abs=1e-6)
    assert band.deviation == pytest.approx(np.std(values, ddof=1), abs=1e-6)
    assert band.low <= min(values) and band.high >= max(values) and band.attempts == len(values)
    alike = band.high - band.low <= 1e-5 * max(abs(band.low), abs(band.high))  # but for the rounding of the file
    assert math.isnan(band.z(0.0)) if alike else band.z(band.mean) == 0


@pytest.mark.parametrize("name", SHIPPED_EXERCISES)
def test_the_experts_band_is_of_attempts_that_pass(name):
    table = json.loads(files("sonospline.training").joinpath("expert_band.json").read_bytes())
    rows, bands = table["exercises"][name], shipped_band(name)
    assert set(rows) == set(METRICS) and "scripts/make_expert_band.py" in table["made_by"]
    for metric, mark in Exercise.shipped(name).pass_mark.items():
        assert len(rows[metric]) == 12
        assert mark.most is None or max(rows[metric]) <= mark.most
        assert mark.least is None or min(rows[metric]) >= mark.least
        assert bands[metric].attempts == 12


def test_an_exercise_that_is_not_shipped_has_no_band():
    assert shipped_band("mine") == {}


def there_and_back():
    """In to 30 mm, back to 10, in to 40, out: straight down, blind from 10 mm on; a sample each mm, 10 a second."""
    depth = np.concatenate([[np.nan], np.arange(1.0, 31), np.arange(29.0, 9, -1), np.arange(11.0, 41), [np.nan]])
    n = len(depth)
    tip = depth[:, None] * [0, 0, 1.0]
    away = np.where(depth > 10, 5.0, 0.0)
    return Trace.of_needle(
        time_s=0.1 * np.arange(n), entry=np.where(np.isnan(tip), np.nan, 0.0), tip=tip, target=(0, 0, 42),
        out_of_plane=away, half_slice=1.0,
    )  # fmt: skip


def result_of(trace, ended="on target"):
    exercise = Exercise.shipped("vessel-in-plane")
    return SimpleNamespace(exercise=exercise, trace=trace, ended=ended, metrics=measure(trace, Task()))


def test_what_happened_is_in_order_and_where_it_was():
    trace = there_and_back()
    found = happenings(result_of(trace), [(1.25, 'punctured "wall" at 1 N')])
    assert [one.kind for one in found] == ["skin", "blind", "tissue", "back", "blind", "out", "end"]
    times = {one.text: one.time_s for one in found}
    assert times["skin"] == pytest.approx(0.1) and times["turned back"] == pytest.approx(3.0)
    blind = [one for one in found if one.kind == "blind"]
    assert [one.text for one in blind] == ["blind for 20 mm", "blind for 30 mm"]
    assert (blind[0].time_s, blind[0].until_s) == pytest.approx((1.1, 3.0))
    assert sum(mm for *_, mm in blind_stretches(trace)) == pytest.approx(measure(trace)["blind_advance_mm"])


def test_a_pause_does_not_part_a_blind_stretch():
    depth = np.repeat(np.arange(1.0, 11), 3)
    trace = Trace.of_needle(
        time_s=np.arange(30.0), entry=(0, 0, 0), tip=depth[:, None] * [0, 0, 1.0], target=(0, 0, 20), out_of_plane=3.0
    )
    assert [(a, b) for a, b, _ in blind_stretches(trace)] == [(0, 29)]


def test_a_course_has_both_ends_and_no_more_samples_than_a_screen_has_columns():
    n = 5000
    trace = Trace.of_needle(
        time_s=np.arange(n) / 50, entry=(1, 2, 3), tip=[1, 2, 3] + np.linspace(0, 30, n)[:, None] * [0, 0, 1.0],
        target=(1, 2, 43), out_of_plane=0.5,
    )  # fmt: skip
    skin = SkinFrame(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.array([1.0, 2, 3]))
    found = course(trace, skin)
    assert len(found.time_s) == 1500 and (found.time_s[0], found.time_s[-1]) == (0, 4999 / 50)
    assert found.depth[-1] == pytest.approx(30) and found.to_target[-1] == pytest.approx(10)
    assert found.tip[-1] == pytest.approx([0, 30, 0]) and found.out_of_plane[0] == -0.5, "towards the viewer is plus"


def test_the_story_says_what_the_metrics_say():
    result = result_of(there_and_back())
    skin = SkinFrame(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.zeros(3))
    found = course(result.trace, skin)
    said = " ".join(story(result, found, happenings(result, [])))
    assert "in after 0.1 s, 32 mm from the middle of its zone" in said
    assert "50 mm in all" in said and "redirected once" in said and "2.0 mm from the target" in said
    out = Trace.of_needle(time_s=[0, 1], entry=np.nan, tip=np.full((2, 3), np.nan), target=(0, 0, 1))
    assert story(result_of(out), found, ()) == ("The needle was not put in.",)

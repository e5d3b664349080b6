"""Exercises: what fits their scenes, starts that are not aimed, attempts that end, and hands that pass and fail."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from sonospline.simulator import make_scene
from sonospline.simulator.scene_file import SceneError
from sonospline.training import SHIPPED_EXERCISES, Attempt, Exercise, Expert, Novice, measure, performed

BLOCK = """
name = "Block"
description = "Reach the vessel."
level = 1
scene = "gel"
target = "vessel"
model = "kelvinlet"
time_limit_s = 20
most_passes = 2
target_in = ["blood"]

[start]
u = [-40.0, -28.0]
angle = [20.0, 60.0]
swing = [-20.0, 20.0]

[entry_zone]
u = [-42.0, -22.0]
v = [-10.0, 10.0]

[pass_mark]
final_error_mm = {most = 3.0}
passes = {most = 1}
"""


@pytest.fixture(scope="module")
def scene():
    return make_scene(Exercise.parse(BLOCK).scene_file())


def attempt(scene, **changes):
    return Attempt(replace(Exercise.parse(BLOCK), **changes), scene, seed=1)


@pytest.mark.parametrize("name", SHIPPED_EXERCISES)
def test_a_shipped_exercise_fits_its_scene(name):
    exercise = Exercise.shipped(name)
    spec = exercise.scene_file()
    assert exercise.pass_mark["final_error_mm"].most <= 5
    assert exercise.look is None or spec.needle.look == exercise.look
    assert exercise.level == 1 or not {"path", "tip", "3-D view"} & set(exercise.guides)


def test_three_levels_in_three_scenes():
    shipped = [Exercise.shipped(name) for name in SHIPPED_EXERCISES]
    assert {exercise.level for exercise in shipped} == {1, 2, 3}
    assert {exercise.scene for exercise in shipped} == {"gel", "cube", "kidney"}


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_start_is_drawn_by_its_seed_and_is_never_aimed(scene, seed):
    exercise = Exercise.parse(BLOCK)
    start = exercise.start_in(scene, seed)
    assert start == exercise.start_in(scene, seed)
    assert start.needle.depth == 0
    assert -40 <= start.needle.u <= -28 and 20 <= start.needle.angle <= 60
    entry, along = scene.frame.entry(start.needle), scene.frame.direction(start.needle)
    missed = scene.targets["vessel"] - entry
    assert np.linalg.norm(missed - (missed @ along) * along) >= 6


def test_an_attempt_goes_from_the_briefing_to_the_debrief(scene):
    made = attempt(scene)
    assert made.state == "briefing"
    with pytest.raises(ValueError, match=r"^the attempt has no frame yet; begin"):
        made.frame  # noqa: B018
    with pytest.raises(ValueError, match=r"^the attempt is in its briefing, not running"):
        made.step(made.command)
    made.begin()
    for depth in range(1, 20):
        made.step(made.command.with_needle(depth=float(depth)), dt=0.1)
    result = made.say_on_target()
    assert (made.state, result.ended, result.passed) == ("debrief", "on target", False)
    assert result.verdict.startswith("not yet: final_error_mm is ")
    assert result.metrics["needle_path_mm"] == pytest.approx(19)
    assert result.metrics == pytest.approx(measure(result.trace, made.exercise.task), nan_ok=True)
    with pytest.raises(ValueError, match=r"^the attempt is in its debrief, not running; make another"):
        made.give_up()


def test_time_and_passes_end_an_attempt(scene):
    made = attempt(scene, time_limit_s=5.0)
    made.begin()
    while made.state == "running":
        made.step(made.command, dt=0.5)
    assert (made.result.ended, made.result.metrics["time_s"]) == ("time is up", 5.0)
    made = attempt(scene)
    made.begin()
    for depth in (5.0, 0.0, 5.0, 0.0, 5.0):
        made.step(made.command.with_needle(depth=depth), dt=0.1)
    assert made.result.ended == "too many passes"
    assert made.result.verdict.startswith("not yet: too many passes; ")


def test_a_needle_enters_in_its_zone_alone(scene):
    made = attempt(scene)
    made.begin()
    before = made.frame
    with pytest.raises(ValueError, match=r"^needle.u = -10 is beside the entry zone; enter at -42 to -22 mm"):
        made.step(made.command.with_needle(u=-10.0, depth=5.0), dt=0.1)
    assert made.frame is before
    made.step(made.command.with_needle(u=-10.0), dt=0.1)  # held above it, it may be anywhere


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("level = 1", "level = 7"), "level = 7 is out of range"),
        (('target = "vessel"', 'target = "liver"'), "target = 'liver' of .* is not in its scene; give one of vessel"),
        (("u = [-40.0, -28.0]", "u = [-28.0, -40.0]"), r"start.u = \(-28, -40\) is empty; give the lower end first"),
        (("final_error_mm", "final_eror_mm"), "pass_mark.final_eror_mm is no metric; choose of time_s"),
        (("passes = {most = 1}", "passes = {}"), "pass_mark.passes has neither least nor most; give one"),
        (
            ("passes = {most = 1}", "passes = {least = 3, most = 1}"),
            "pass_mark.passes has least = 3 above most = 1; exchange them",
        ),
        (("level = 1", 'level = 1\nlook = "sword"'), "look = 'sword' is not known; choose one of"),
        (("level = 1", "level = 1\nguids = []"), "guids is not known"),
        (("angle = [20.0, 60.0]", "angle = [40.0, 400.0]"), "needle.angle = .* is out of range"),
        (("level = 1", 'level = 1\n[[targets]]\nname = "deep"\nat = [60.0, 30.0, 400.0]\n[[x'), "is not TOML"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(scene, change, said):
    assert change[0] in BLOCK
    with pytest.raises(ValueError, match=said) as error:
        for seed in range(20):
            Exercise.parse(BLOCK.replace(*change, 1)).start_in(scene, seed)
    assert "\n" not in str(error.value)


def test_a_target_out_of_reach_a_start_that_is_always_aimed_and_an_unknown_exercise(scene):
    short = replace(scene.spec, needle=replace(scene.spec.needle, length_mm=20.0))
    with pytest.raises(ValueError, match=r"mm from the entry zone, and the needle is 20 mm long; widen the zone"):
        Exercise.parse(BLOCK).start_in(make_scene(short), 0)
    straight = "[start]\nu = [0.0, 0.0]\nv = [0.0, 0.0]\nangle = [90.0, 90.0]\nswing = [0.0, 0.0]\n\n[entry_zone]"
    text = BLOCK[: BLOCK.index("[start]")] + straight + BLOCK[BLOCK.index("[entry_zone]") + len("[entry_zone]") :]
    with pytest.raises(ValueError, match="is in bone or aimed within 6 mm, in 1000 draws; give wider ranges"):
        Exercise.parse(text).start_in(scene, 0)
    with pytest.raises(ValueError, match=r"^exercise = 'suture' is not known; choose one of vessel-in-plane"):
        Exercise.shipped("suture")
    with pytest.raises(SceneError, match=r"^mine.toml, line 1: is not TOML"):
        Exercise.parse("level = ", file="mine.toml")


@pytest.mark.slow
def test_an_expert_passes_and_who_holds_a_key_does_not(scene):
    expert, novice = performed(attempt(scene), Expert()), performed(attempt(scene), Novice())
    assert expert.passed, expert.verdict
    assert not novice.passed
    assert expert.metrics["final_error_mm"] < 1 < 10 < novice.metrics["final_error_mm"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED_EXERCISES)
def test_the_expert_passes_every_exercise_and_the_novice_none(name):
    exercise = Exercise.shipped(name)
    made = make_scene(exercise.scene_file())
    across = "blind_advance_mm" not in exercise.pass_mark
    results = [performed(Attempt(exercise, made, seed=3), hand, dt=0.2) for hand in (Expert(across=across), Novice())]
    assert [result.passed for result in results] == [True, False], [result.verdict for result in results]
    assert results[0].metrics["final_error_mm"] < 0.2 * results[1].metrics["final_error_mm"]
    if not across:
        assert results[0].metrics["blind_advance_mm"] + 20 < results[1].metrics["blind_advance_mm"]

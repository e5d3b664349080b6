"""A number that is refused: the message asks for the right kind of number, and what it asks for is taken."""

import re
from typing import get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonospline as ss
from sonospline._shown import figure, inside
from sonospline.geometry import facing
from sonospline.io.records import FieldError
from sonospline.simulator import SceneFile
from sonospline.simulator.command import Command, ImageSettings, NeedleCommand, ProbeCommand
from sonospline.simulator.knobs import Circumstances, Knobs
from sonospline.simulator.scene_file import DisplayPart, ModelPart, NeedlePart, ProbePart, TissuePart
from sonospline.ultrasound import Phantom, Probe, Scanner

PARTS = {"tissue": TissuePart, "model": ModelPart, "needle": NeedlePart, "probe": ProbePart, "display": DisplayPart}
NUMBERS = [
    (part, name, hint)
    for part, kind in PARTS.items()
    for name, hint in get_type_hints(kind).items()
    if hint in (int, float, float | None)
]


def scene(part, name, value):
    tables = {"tissue": 'source = "gel block"\n', **({part: ""} if part != "tissue" else {})}
    tables[part] += f"{name} = {value}\n"
    return 'name = "x"\n' + "".join(f"[{table}]\n{text}" for table, text in tables.items())


@pytest.mark.parametrize("value", ["-99999", "-99999.5", "1e9", "99999999999", "true", '"a"', "nan", "[1]"])
@pytest.mark.parametrize(("part", "name", "hint"), NUMBERS, ids=lambda item: item if isinstance(item, str) else "")
def test_a_scene_file_asks_for_the_kind_of_number_it_takes(part, name, hint, value):
    with pytest.raises(ValueError, match="; give ") as refused:
        SceneFile.parse(scene(part, name, value))
    kind, low, high = re.search(r"give (a number|a whole number) from (\S+) to (\S+)$", str(refused.value)).groups()
    assert kind == ("a whole number" if hint is int else "a number")
    for end in (low, high):
        SceneFile.parse(scene(part, name, int(float(end)) if hint is int else float(end)))


@given(low=st.floats(-1e4, 1e4), high=st.floats(-1e4, 1e4))
def test_the_ends_that_a_message_names_are_within(low, high):
    low, high = min(low, high), max(low, high)
    lowest, highest = (float(end) for end in inside(low, high))
    slack = 1e-5 * max(abs(low), abs(high))
    assert low <= lowest <= low + slack
    assert high - slack <= highest <= high


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_figure_is_the_number(value):
    assert float(figure(value)) == value


def test_a_state_just_beyond_a_limit_is_not_told_that_it_is_within():
    spec = SceneFile.parse(scene("needle", "length_mm", 200 / 3))
    knobs = Knobs.of(Command, Circumstances(spec, Probe.linear(), (-9, 9), (-9, 9), 99.0, synthetic=True))
    state = Command(
        needle=NeedleCommand(u=0, v=0, angle=90, swing=0, depth=66.6667), probe=ProbeCommand(),
        image=ImageSettings(gain=0, depth=45, frequency=7, focus=20),
    )  # fmt: skip
    with pytest.raises(FieldError, match=r"needle.depth = 66.6667 is out of range; give 0 to 66.6666 in this scene"):
        knobs.check(state)
    knobs.check(state.with_needle(depth=66.6666))


TISSUE = ss.Tissue(ss.Grid.unit_cube(7))
REFUSED = {
    "drag": (
        lambda: ss.KelvinletInsertion(TISSUE, ss.DragModel.kelvinlet(drag=1e300)),
        "drag = 1e.300 is far beyond",
    ),
    "smoothing": (
        lambda: ss.Insertion(TISSUE, smoothing=1e300),
        r"smoothing = 1e\+300 leaves only .*give at most 5e\+05",
    ),
    "steps": (
        lambda: ss.Insertion(TISSUE).run((0, 0.5, 0.5), (0.5, 0.5, 0.5), 10**20),
        r"steps = 1\d+ are .*give fewer",
    ),
    "nodes": (
        lambda: ss.Tissue(ss.Grid.unit_cube(10**6)).pinned,
        "a mask of its nodes would take .* use a coarser grid",
    ),
    "frequency": (lambda: Probe.linear(frequency_mhz=1e300), "does not go with a pulse .*give a lower frequency"),
    "long pulse": (lambda: Probe.linear(frequency_mhz=1e-9), "does not go with a pulse .*give a higher frequency"),
    "seed": (
        lambda: Scanner(
            Phantom.uniform("liver", size_mm=(9, 9, 9)), Probe.linear(lines=16),
            facing((5, 5, 0), depth=(0, 0, 1), right=(1, 0, 0)), seed=2**64,
        ),
        "seed = 18446744073709551616 is too large; give at most 18446744073709551615",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("make", "message"), REFUSED.values(), ids=REFUSED)
def test_absurd_numbers_are_refused_with_a_remedy(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_more_landmarks_than_memory_holds_are_refused(monkeypatch):
    monkeypatch.setattr("sonospline._memory._NEVER_REFUSED", 0)
    monkeypatch.setattr("sonospline._memory.available_bytes", lambda: 100_000)
    with pytest.raises(
        ValueError, match=r"max_landmarks = 300: the factor of \d+ landmarks would take .*; use fewer landmarks"
    ):
        ss.Insertion(ss.Tissue(ss.Grid.unit_cube(7)), anchors=2).advance(ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5)))


def test_smoothing_up_to_its_limit_is_solved():
    insertion = ss.Insertion(TISSUE, smoothing=4e5)
    assert np.isfinite(insertion.advance(ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5))).on_grid()).all()

"""Numbers seen from the skin and poses in the world: each is the other's inverse, and what has none is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from simulator_scenes import SMALL
from sonospline.geometry import facing
from sonospline.simulator import Console, NeedleCommand, ProbeCommand, SceneFile, Session, make_scene
from sonospline.simulator.skin_frame import SkinFrame

PRESS_MM = 4.0
coordinate, offset = st.floats(-60, 60), st.floats(-1, 1)


@st.composite
def frames(draw):
    """A skin anywhere, facing anywhere."""
    right = np.array([draw(offset), draw(offset), 1.7 + draw(offset)])
    other = np.array([1.7 + draw(offset), draw(offset), draw(offset)])
    right /= np.linalg.norm(right)
    depth = other - (other @ right) * right
    origin = np.array([draw(coordinate), draw(coordinate), draw(coordinate)])
    return SkinFrame(right, depth / np.linalg.norm(depth), origin)


needles = st.builds(
    NeedleCommand, u=coordinate, v=coordinate, angle=st.floats(5, 175), swing=st.floats(-60, 60),
    depth=st.floats(0.05, 200),
)  # fmt: skip
probes = st.builds(
    ProbeCommand, slide=coordinate, sweep=coordinate, rotate=st.floats(-179.9, 179.9), fan=st.floats(-60, 60)
)


def numbers(command):
    return [getattr(command, name) for name in command.__struct_fields__]


@given(frames(), needles)
@settings(deadline=None)
def test_a_needle_and_its_numbers_are_inverses(frame, command):
    needle = frame.needle(command)
    found = frame.needle_command(needle)
    assert numbers(found) == pytest.approx(numbers(command), abs=1e-6)
    again = frame.needle(found)
    assert again.entry == pytest.approx(needle.entry, abs=1e-9)
    assert again.tip == pytest.approx(needle.tip, abs=1e-9)


@given(frames(), probes)
@settings(deadline=None)
def test_a_probe_and_its_numbers_are_inverses(frame, command):
    place = frame.probe_to_reference(command, PRESS_MM)
    found = frame.probe_command(place, PRESS_MM)
    assert numbers(found) == pytest.approx(numbers(command), abs=1e-6)
    assert frame.probe_to_reference(found, PRESS_MM) == pytest.approx(place, abs=1e-9)


@given(st.floats(-180, 180))
@settings(deadline=None)
def test_half_a_turn_is_the_same_from_either_side(turn):
    frame = SkinFrame(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.zeros(3))
    found = frame.probe_command(frame.probe_to_reference(ProbeCommand(rotate=turn), 0.0), 0.0)
    assert (found.rotate - turn + 180) % 360 - 180 == pytest.approx(0, abs=1e-6)


UPRIGHT = SkinFrame(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.array([60.0, 30, 0]))


@pytest.mark.parametrize(
    ("needle", "says"),
    [
        (ss.Needle((60, 30, 5), (60, 30, 20)), "entry = .* is 5 mm below the skin; give where the needle crosses it"),
        (ss.Needle((60, 30, -2), (60, 30, 20)), "entry = .* is 2 mm above the skin"),
        (ss.Needle((60, 30, 0), (60, 20, 0)), "is square to the rest image and has no angle; turn it"),
    ],
)
def test_a_needle_that_the_numbers_cannot_say_is_refused(needle, says):
    with pytest.raises(ValueError, match=says):
        UPRIGHT.needle_command(needle)


@pytest.mark.parametrize(
    ("place", "says"),
    [
        (facing((60, 30, 1), depth=(0, 0, 1), right=(1, 0, 0)), "its origin 1 mm below the skin; place it 4 mm below"),
        (
            facing((60, 30, 4), depth=(0.1, 0, 1), right=(1, 0, 0)),
            "rocked by -5.71 degrees about its z; give an x along",
        ),
        (np.diag([1, 1, 2, 1]), "probe_to_reference is not rigid"),
    ],
)
def test_a_probe_that_the_numbers_cannot_say_is_refused(place, says):
    with pytest.raises(ValueError, match=says):
        UPRIGHT.probe_command(place, PRESS_MM)


@pytest.fixture(scope="module")
def console():
    return Console(Session(make_scene(SceneFile.parse(SMALL)), model="paper"))


def test_a_frame_leads_back_to_its_command(console):
    command = console.scene.start.with_needle(depth=30.0, swing=5.0).with_probe(sweep=2.0, fan=-10.0, rotate=30.0)
    frame = console.step(command)
    needle, probe = console.needle_command(frame.needle), console.probe_command(frame.probe_to_reference)
    assert numbers(needle) == pytest.approx(numbers(frame.command.needle), abs=1e-6)
    assert numbers(probe) == pytest.approx(numbers(frame.command.probe), abs=1e-6)


@pytest.mark.parametrize(
    ("needle", "says"),
    [
        (ss.Needle((60, 30, 0), (60, 30, 120)), r"needle.depth = 120 is out of range; give 0 to 80 in this scene"),
        (ss.Needle((60, 30, 0), (60, 30, -5)), r"needle.angle = -90 is out of range; give 5 to 175"),
        (ss.Needle((60, 30, 0), (60, 15, 5)), r"needle.swing = 71.56\d* is out of range; give -60 to 60"),
        (ss.Needle((200, 30, 0), (170, 30, 5)), r"needle.u = 140 is out of range; give -60 to 60"),
    ],
)
def test_a_pose_beyond_the_scenes_limits_is_refused(console, needle, says):
    with pytest.raises(ValueError, match=says):
        console.needle_command(needle)
    with pytest.raises(ValueError, match=r"probe.fan = 70 is out of range"):
        console.probe_command(console.scene.frame.probe_to_reference(ProbeCommand(fan=70.0), 0.0))

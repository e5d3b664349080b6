"""A needle turns no further than the tissue beside its shaft holds, in the model, in sessions and by knobs."""

import pickle

import numpy as np
import pytest

import sonospline as ss
from simulator_scenes import SMALL
from sonospline.contact import Held
from sonospline.contact.turning import between, loads
from sonospline.mechanics import Material
from sonospline.models.elastic import ElasticModel
from sonospline.simulator import Console, SceneFile, Session, TissueSettings, make_scene

TRACK = TissueSettings(contact="track")
TISSUE = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))


def model(strength):
    material = Material(10.0, lateral_strength_n_per_mm=strength)
    return ElasticModel(TISSUE, material, contact="track", nodes=9**3)


def tilted(degrees, depth=50.0):
    angle = np.radians(degrees)
    return ss.Needle((0, 50, 50), (depth * np.cos(angle), 50 + depth * np.sin(angle), 50))


@pytest.fixture(scope="module")
def pushed():
    made = model(0.05)
    state = made.rest
    for depth in (15.0, 30.0, 50.0):
        state = made.step(state, {"needle": tilted(0, depth)}, 0.5).state
    return made, state


def test_a_needle_turns_until_the_load_is_what_tissue_holds(pushed):
    made, state = pushed
    start, end = tilted(0), tilted(15)
    held = made.held(state, "needle", start, end)
    assert 0.02 < held.share < 0.98 and (held.needle, held.by) == ("needle", "")
    response = made.step(state, {"needle": between(start, end, held.share)}, 0.2)
    for _ in range(6):
        response = made.step(response.state, dict(response.state.needles), 0.0)
    (_, track), *_ = response.state.tracks
    assert loads(made._in_time.medium, track).max() == pytest.approx(1.0, abs=0.15)
    there = between(start, end, held.share)
    assert made.held(response.state, "needle", there, tilted(25)).share < 0.15, "it is at its end"
    assert made.held(response.state, "needle", there, start) is None, "back it may"


def test_twice_the_strength_turns_it_twice_as_far(pushed):
    _, state = pushed
    shares = []
    for strength in (0.03, 0.06):
        made = model(strength)
        of_this = state.__class__(made.identity, **{k: v for k, v in vars(state).items() if k != "model"})
        shares.append(made.held(of_this, "needle", tilted(0), tilted(20)).share)
    assert shares[1] == pytest.approx(2 * shares[0], rel=0.1)


def test_what_is_pushed_or_pulled_along_its_axis_or_is_free_is_not_held(pushed):
    made, state = pushed
    assert made.held(state, "needle", tilted(0), tilted(0, 20.0)) is None
    assert made.held(state, "needle", tilted(0), tilted(0, 70.0)) is None
    assert made.held(state, "another", tilted(0), tilted(30)) is None
    fresh = ElasticModel(TISSUE, Material(10.0), nodes=9**3)
    of_pose = fresh.step(fresh.rest, {"needle": tilted(0)}).state
    assert fresh.held(of_pose, "needle", tilted(0), tilted(30)) is None


def test_a_strength_is_above_zero():
    with pytest.raises(
        ValueError, match=r"lateral_strength_n_per_mm = 0.0 is out of range; give a finite number above"
    ):
        Material(lateral_strength_n_per_mm=0.0)


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL))


def inside(scene, tissue=TRACK):
    console = Console(Session(scene))
    console.step(console.command.with_tissue(contact=tissue.contact))
    for depth in (10.0, 20.0, 30.0):
        frame = console.step(console.command.with_needle(depth=depth), dt=0.3)
        assert frame.blocked is None
    return console, frame


def test_the_hand_is_held_in_words_and_does_not_wind_up(scene):
    console, frame = inside(scene)
    first = frame.command.needle.angle
    frame = console.step(console.command.with_needle(angle=first + 18.0), dt=0.1)
    assert (frame.blocked, frame.held_by, frame.bone) == ("held", "phantom gel", None)
    most = frame.command.needle.angle
    assert 2 < most - first < 17
    assert frame.needle.direction == pytest.approx(scene.frame.direction(frame.command.needle), abs=1e-9)
    assert [event.by for event in frame.events if isinstance(event, Held)] == ["phantom gel"]
    assert not frame.log, "it is a state and no event"
    for _ in range(4):  # who goes on asking gets no further to speak of
        frame = console.step(console.command.with_needle(angle=frame.command.needle.angle + 2.0), dt=0.1)
    assert frame.command.needle.angle - most < 1.5
    back = console.step(console.command.with_needle(angle=frame.command.needle.angle - 1.0), dt=0.1)
    assert (back.blocked, back.held_by) == (None, None)
    deeper = console.step(console.command.with_needle(depth=32.0), dt=0.1)
    assert (deeper.blocked, deeper.command.needle.depth) == (None, 32.0)


def test_without_tracks_a_needle_turns_as_it_did(scene):
    console, frame = inside(scene, TissueSettings())
    first = frame.command.needle.angle
    frame = console.step(console.command.with_needle(angle=first + 9.0))
    assert (frame.blocked, frame.held_by) == ("needle inside", None)
    assert frame.command.needle.angle == first + 5.0


def test_sessions_hold_each_needle_with_the_breath_and_go_on_from_copies(scene):
    session = Session(scene)
    poses = {name: ss.Needle((26.0, y, 0.0), (48.0, y, 18.0)) for name, y in (("a", 22.0), ("b", 38.0))}
    session.step(needles=poses, tissue=TRACK, dt=0.3)
    turned = {"a": ss.Needle((26.0, 22.0, 0.0), (41.0, 22.0, 24.0)), "b": poses["b"]}
    other = Session(scene)
    other.resume(pickle.loads(pickle.dumps(session.last)))
    frame = session.step(needles=turned, dt=0.1)
    assert [event.needle for event in frame.events if isinstance(event, Held)] == ["a"]
    assert frame.needles["b"] == poses["b"] and frame.needles["a"].depth == pytest.approx(turned["a"].depth)
    assert frame.undeformed["a"] == frame.needles["a"] == dict(frame.response.state.needles)["a"]
    again = other.step(needles=turned, dt=0.1)
    assert again.needles == frame.needles and (again.field.values == frame.field.values).all()

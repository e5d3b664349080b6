"""A session and a console in tissue with bone: where needles stop, what is said, and what goes on."""

from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from simulator_scenes import SMALL, write_ribs
from sonospline.contact import Touched
from sonospline.mechanics import Blocked, TissueMap
from sonospline.server import wire
from sonospline.server.scene_catalog import Entry, SceneCatalog
from sonospline.simulator import Console, SceneFile, Session, make_scene
from sonospline.simulator.constraint import constrain

pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

SURFACE_MM = 23.0


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(write_ribs(tmp_path_factory.mktemp("ribs")))


@pytest.fixture(scope="module")
def made(scene):
    return Session(scene, model="kelvinlet")


@pytest.fixture
def session(made):
    """As at first; its model is made once."""
    made.resume(None)
    return made


@pytest.fixture
def console(session):
    return Console(session)


def push(console, depth, **where):
    return console.step(console.command.with_needle(depth=depth, **where))


def straight(scene, depth, u=0.0):
    entry = scene.frame.origin + u * scene.frame.right
    return ss.Needle(entry, entry + depth * scene.frame.depth)


@pytest.mark.parametrize("model", ["paper", "kelvinlet", "elastic"])
def test_a_push_stops_at_bone_whatever_the_model_knows_of_it(scene, model):
    console = Console(Session(scene, model=model))
    assert push(console, 10.0).blocked is None
    for depth in (22.0, 40.0, 120.0):
        frame = push(console, depth)
    assert (frame.blocked, frame.bone) == ("bone", "rib_left_8")
    assert frame.readouts.depth == frame.command.needle.depth == pytest.approx(SURFACE_MM, abs=2e-3)
    assert frame.events == (Blocked("needle", "rib_left_8", frame.needle.depth),)
    resting = console.settle()
    assert (resting.blocked, resting.command) == ("bone", frame.command)
    back = push(console, frame.command.needle.depth - 0.1)
    assert (back.blocked, back.bone, back.events) == (None, None, ())
    assert push(console, 0.0).readouts.moved == 0


def test_console_session_and_model_look_once_for_bone_before_a_needle(console, monkeypatch):
    push(console, 5.0)
    looked = []
    monkeypatch.setattr(TissueMap, "_first_met", lambda self, needle, rigid: looked.append(needle))
    push(console, 8.0)
    assert [needle.depth for needle in looked] == [pytest.approx(8.0, abs=0.1)]


def test_a_needle_over_bone_at_the_skin_does_not_go_in(console):
    frame = push(console, 5.0, u=36.0)
    assert (frame.blocked, frame.bone, frame.needle, frame.command.needle.depth) == ("bone", "rib_left_7", None, 0)
    assert push(console, 5.0, u=20.0).blocked is None, "beside it, it does"


@pytest.mark.parametrize("sign", [1, -1])
def test_a_needle_inside_turns_as_far_as_the_bone_beside_it(console, sign):
    """Beside the rib, its edge 2 mm away from the entry: at 29 mm of depth the shaft meets it."""
    free = push(console, 40.0, u=-12.0 if sign > 0 else 12.0)
    assert free.blocked is None
    turned = console.step(console.command.with_needle(angle=90 - 5.0 * sign))
    assert (turned.blocked, turned.bone, turned.command.needle.depth) == ("bone", "rib_left_8", 40.0)
    assert turned.command.needle.angle == pytest.approx(90 - sign * np.degrees(np.arctan2(2, 29)), abs=0.01)
    assert console.step(console.command.with_needle(angle=90 + 3.0 * sign)).blocked is None


def test_a_turn_does_not_jump_across_a_thin_bone(console):
    push(console, 58.0, u=-29.0, angle=94.0)
    across = console.step(console.command.with_needle(angle=86.0))
    assert (across.blocked, across.bone) == ("bone", "rib_left_9")
    assert 90.0 < across.command.needle.angle < 94.0
    out = push(console, 0.0, angle=86.0)
    assert (out.blocked, out.command.needle.angle) == (None, 86.0)


def test_a_needle_that_lies_in_bone_comes_back_to_its_surface_before_it_turns(scene):
    """However it got there: a frame of an older session, another label map."""
    behind = scene.start.needle.__class__(u=0, v=0, angle=90, swing=0, depth=50.0)
    command = scene.start.with_needle(depth=50.0, angle=92.0)
    held = constrain(scene, command, behind, behind)
    assert (held.blocked, held.bone) == ("bone", "rib_left_8")
    assert held.command.needle.depth == pytest.approx(SURFACE_MM / np.sin(np.radians(92)), abs=0.01)


def test_a_session_that_goes_on_behind_bone_comes_back_to_its_surface(scene, session):
    frame = session.step(needles={"needle": straight(scene, 20.0)})
    session.resume(replace(frame, needles={"needle": straight(scene, 50.0)}))
    resumed = session.step()
    assert resumed.needle.depth == pytest.approx(SURFACE_MM, abs=2e-3)
    assert resumed.events[0].by == "rib_left_8"


def test_several_needles_by_poses(scene):
    session, over, beside = Session(scene, model="elastic"), straight(scene, 40.0), straight(scene, 40.0, u=15.0)
    frame = session.step(needles={"over": over, "beside": beside})
    assert list(frame.needles) == ["over", "beside"]
    assert frame.needles["over"].depth == pytest.approx(SURFACE_MM, abs=2e-3)
    assert frame.needles["beside"] is beside
    rests = Blocked("over", "rib_left_8", frame.needles["over"].depth)
    assert frame.events == (rests, Touched("over", "rib_left_8"))
    with pytest.raises(ValueError, match="lies in bone, rib_left_7"):
        session.step(needles={"over": over, "skin": straight(scene, 20.0, u=36.0)})
    assert session.last is frame


def test_a_frame_says_on_the_wire_which_bone_it_is(console):
    summary = wire.PassSummary(time_s=0.0, passes=1, path_mm=None, blind_mm=None)
    header = wire.read(wire.frame(push(console, 40.0), number=1, seq=1, guides=frozenset(), summary=summary))[1]
    assert (header["blocked"], header["bone"]) == ("bone", "rib_left_8")


def test_a_scene_without_bone_asks_nothing_of_its_labels(monkeypatch):
    scene = make_scene(SceneFile.parse(SMALL))
    assert scene.tissues is not None and not scene.has_bone
    monkeypatch.setattr(TissueMap, "obstacle", None)
    monkeypatch.setattr("sonospline.simulator.constraint.pushed", None)
    monkeypatch.setattr("sonospline.simulator.constraint.turned", None)
    inside = scene.start.with_needle(depth=30.0).needle
    held = constrain(scene, scene.start.with_needle(depth=31.0, angle=40.0), inside, inside)
    assert (held.blocked, held.bone, held.command.needle.angle) == (None, None, 40.0)


def test_bone_that_no_model_can_hold_is_said_before_anyone_pushes(tmp_path, caplog):
    text = write_ribs(tmp_path).read_text().replace("[model]", 'materials = "loose.toml"\n[model]\nuse = "elastic"')
    (tmp_path / "loose.toml").write_text('["rib_*"]\nrigid = true\nfloating = true\n')
    catalog = SceneCatalog({"ribs": Entry(SceneFile.parse(text), tmp_path)})
    try:
        console = catalog.order("ribs", None, lambda share: None).result(60).console
        for _ in range(2):  # what follows the first is done before the second
            catalog.geometry(console).result(60)
    finally:
        assert catalog.close(60)
    assert "the scene cannot be made ready for a push: labels: a floating fragment" in caplog.text

"""A session whose probe dents the skin: the dent follows it, its force is read, states, pictures and targets know."""

import pickle

import numpy as np
import pytest

import sonospline as ss
from simulator_scenes import SMALL
from sonospline.simulator import Console, ProbeCommand, SceneFile, Session, TissueSettings, make_scene

PRESSES = TissueSettings(probe="presses")
ENTRY, TIP = (22.0, 30.0, 0.0), (54.0, 30.0, 21.0)
NEEDLE = {"needle": ss.Needle(ENTRY, TIP)}


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL))


def pose(scene, **numbers):
    return scene.frame.probe_to_reference(ProbeCommand(**numbers), scene.spec.probe.press_mm)


@pytest.fixture(scope="module")
def pressed(scene):
    session = Session(scene)
    session.step(probe_to_reference=pose(scene, press=6.0), tissue=PRESSES)
    return session


def again(session):
    """A session that goes on from a copy, which shares what was solved."""
    other = Session(session.scene)
    other._models, other._pressed = session._models, session._pressed
    other.resume(pickle.loads(pickle.dumps(session.last)))
    return other


def surface(frame, x, y=30.0):
    """How far the skin around a place has moved into the tissue, in the mean."""
    places = np.column_stack([x + np.linspace(-8, 8, 33), np.full(33, y), np.zeros(33)])
    return float(frame.field.displacement(places)[:, 2].mean())


def same(a, b):
    return (
        (a.image.pixels == b.image.pixels).all()
        and (a.field.values == b.field.values).all()
        and (a.target_now == b.target_now).all()
        and str(a.readouts) == str(b.readouts)
    )


def test_a_probe_that_only_looks_changes_nothing(scene):
    plain, asked = Session(scene), Session(scene)
    place = pose(scene, slide=3.0)
    a = plain.step(probe_to_reference=place, needles=NEEDLE)
    b = asked.step(probe_to_reference=place, needles=NEEDLE, tissue=TissueSettings(probe="looks"))
    assert same(a, b) and b.readouts.probe_n is None and b.by_needles is b.field


def test_the_skin_lies_at_the_face_and_the_dent_follows_it(pressed, scene):
    session, first = again(pressed), pressed.last
    assert surface(first, 60.0) == pytest.approx(6.0, abs=0.6)
    assert first.readouts.probe_n > 1 and first.readouts.moved > 0.5
    there = session.step(probe_to_reference=pose(scene, press=6.0, slide=15.0))
    assert surface(there, 75.0) == pytest.approx(6.0, abs=0.6)
    assert surface(there, 45.0) < 0.7 * surface(first, 45.0)
    deeper = session.step(probe_to_reference=pose(scene, press=9.0, slide=15.0))
    assert deeper.readouts.probe_n == pytest.approx(1.5 * there.readouts.probe_n, rel=1e-3), "linear: it lies flat"
    lifted = session.step(probe_to_reference=pose(scene, slide=15.0))
    assert lifted.readouts.probe_n == 0 and not lifted.field.values.any()


def test_picture_and_vessel_give_way(pressed, scene):
    """Round at rest, 7 mm wide: flatter below the probe."""
    angle = np.linspace(0, 2 * np.pi, 60)
    rest = scene.targets["vessel"] + 3.5 * np.column_stack([0 * angle, np.cos(angle), np.sin(angle)])
    now = pressed.last.field.forward(rest)
    assert np.ptp(now[:, 2]) < 0.95 * 7 and np.ptp(now[:, 2]) < np.ptp(now[:, 1])
    shallow = Session(scene).step(probe_to_reference=pose(scene, press=6.0))
    assert (pressed.last.image.pixels != shallow.image.pixels).mean() > 0.1
    vertices = scene.deformed(pressed.last.field, grid=False) - scene.deformed(shallow.field, grid=False)
    assert np.linalg.norm(vertices, axis=1).max() > 1


def test_needles_are_taken_back_and_carried_along(pressed):
    session = again(pressed)
    frame = session.step(needles={**NEEDLE, "second": ss.Needle((88.0, 34.0, 0.0), (70.0, 30.0, 18.0))}, dt=0.1)
    background = pressed.last.field
    for name, needle in frame.needles.items():
        rest = frame.undeformed[name]
        assert background.forward(rest.tip) == pytest.approx(needle.tip, abs=1e-4)
        assert np.linalg.norm(rest.tip - needle.tip) > 0.3
    carried = ss.CarriedField(frame.response.field, background)
    assert frame.target_now == pytest.approx(carried.forward(session.scene.targets["vessel"]), abs=1e-6)


@pytest.mark.parametrize("contact", ["pose", "track"])
def test_whoever_has_a_frame_goes_on_bit_for_bit(pressed, scene, contact):
    session = again(pressed)
    session.step(needles=NEEDLE, tissue=TissueSettings(contact=contact, probe="presses"), dt=0.2)
    other, before = again(session), session.last
    for numbers in ({"press": 7.0}, {"press": 7.5, "slide": 2.2}):
        asked = {"probe_to_reference": pose(scene, **numbers), "dt": 0.1}
        assert same(session.step(**asked), other.step(**asked))
    for one in (session, other):
        one.resume(before)
    assert same(session.step(dt=0.1), other.step(dt=0.1))


def test_a_session_that_presses_pickles_without_what_it_has_solved(pressed):
    text = pickle.dumps(pressed._pressed)
    assert len(text) < 4_000_000
    place = pressed.last.probe_to_reference
    assert pickle.loads(text).at(place).force_n == pressed.last.readouts.probe_n


def test_models_without_time_say_that_they_heed_none_of_it(scene):
    console = Console(Session(scene, model="kelvinlet"))
    frame = console.step(console.command.with_tissue(probe="presses").with_probe(press=5.0))
    assert frame.readouts.probe_n is None and frame.command.probe.press == 0
    assert frame.command.tissue.probe == "presses", "the switch stays for the next model"


def test_the_hand_presses_by_a_knob(pressed, scene):
    console = Console(again(pressed))
    console.session.resume(None)
    assert console.step(console.command.with_probe(press=4.0)).command.probe.press == 0, "it only looks"
    frame = console.step(console.command.with_tissue(probe="presses").with_probe(press=4.0))
    assert frame.command.probe.press == 4.0 and frame.readouts.probe_n > 0.5
    assert console.probe_command(frame.probe_to_reference) == frame.command.probe
    with pytest.raises(ValueError, match=r"probe.press = 20 is out of range; give 0 to 14 in this scene"):
        console.step(console.command.with_probe(press=20.0))
    console.reset()
    assert console.step().readouts.probe_n is None
    console.restore()
    assert console.step().readouts.probe_n == frame.readouts.probe_n


def test_too_deep_and_beside_the_skin_are_refused_and_nothing_has_changed(pressed, scene):
    session = again(pressed)
    for place, said in (
        (pose(scene, press=30.0), "presses 30 mm deep; give at most 23.33 mm, a third of the tissue"),
        (pose(scene, press=5.0, slide=-70.0), "beyond the skin, face z- of the box; slide it back"),
    ):
        with pytest.raises(ValueError, match=said):
            session.step(probe_to_reference=place)
    assert session.last.number == pressed.last.number and not session.last.needles
    assert session.last.readouts.probe_n == pressed.last.readouts.probe_n


@pytest.mark.slow
def test_what_was_recorded_comes_again(pressed, scene, tmp_path):
    pytest.importorskip("mcap", reason="mcap is not installed (pip install 'sonospline[record]')")
    from sonospline.training import Recorder, Recording, replay

    session = Session(scene)
    frames = [session.step(probe_to_reference=pose(scene, press=2.0), tissue=PRESSES)]
    frames += [session.step(probe_to_reference=pose(scene, press=3.0, slide=1.0), needles=NEEDLE, dt=0.1)]
    with Recorder(tmp_path / "pressed.mcap", scene) as recorder:
        for frame in frames:
            recorder.add(frame)
    for found, frame in zip(replay(Recording.read(tmp_path / "pressed.mcap"), scene), frames, strict=True):
        assert same(found.frame, frame)


@pytest.mark.slow
def test_the_kidney_scene_is_painted_under_its_probe_and_its_force_grows_as_in_a_body():
    """At rest nothing moves, though the probe presses; 34.5 N, the largest published, dent by 5 to 25 mm."""
    scene = make_scene("kidney")
    console = Console(Session(scene))
    rest = console.step()
    held = console.step(console.command.with_tissue(probe="presses"))
    assert (held.field.values == 0).all() and 2 < held.readouts.probe_n < 8
    slid = console.step(console.command.with_probe(slide=-70.0))
    at = scene.frame.origin - 70 * scene.frame.right
    assert surface(slid, at[0], at[1]) == pytest.approx(8.0, abs=0.5), "a dent at the new place"
    assert surface(slid, *scene.frame.origin[:2]) < -2.5, "none at the old one"
    assert rest.readouts.probe_n is None
    depths = np.arange(0.25, 18.01, 0.25)
    contact = console.session._pressed._motion._dents.contact
    place = np.array(scene.frame.probe_to_reference(ProbeCommand(), 0.0))
    dents = []
    for depth in depths:
        place[:3, 3] = scene.frame.origin + depth * scene.frame.depth
        dents.append(contact.dent(place))
    force = np.array([dent.force_n for dent in dents])
    assert (np.diff(force) > 0).all()
    assert 5 <= np.interp(34.5, force, depths) <= 25
    strongest = int(np.searchsorted(force, 34.5)) + 1
    work = np.trapezoid([0.0, *force[:strongest]], [0.0, *depths[:strongest]])
    assert work == pytest.approx(dents[strongest - 1].energy_mj, rel=0.01)

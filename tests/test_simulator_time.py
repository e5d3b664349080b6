"""A session in time: breath that moves tissue, needles that remember, and states that hold all of it."""

import pickle
import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from simulator_scenes import SMALL
from sonospline.contact import Left, Punctured, Touched
from sonospline.elasticity.carried import composed, needles_at_rest
from sonospline.mechanics import Blocked, Breathing, Spread
from sonospline.mechanics.breath import Breath
from sonospline.models import registry
from sonospline.simulator import Console, Runner, SceneError, SceneFile, Session, TissueSettings, make_scene
from sonospline.simulator.event_log import logged

BREATHING = """
[breathing]
cranial_face = "x-"
organ = ["blood", "vessel wall"]
depth = 0.2
"""
ENTRY = (26.0, 30.0, 0.0)
TIP = (54.0, 30.0, 21.0)
ALIVE = TissueSettings(breathing="free")


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL + BREATHING))


@pytest.fixture(scope="module")
def breathing(scene):
    """A session two seconds into its first breath, its needle out."""
    session = Session(scene)
    session.step(tissue=ALIVE)
    session.step(dt=1.5)
    return session


def one(share=1.0):
    return {"needle": ss.Needle(ENTRY, np.add(ENTRY, share * np.subtract(TIP, ENTRY)))}


def same(a, b):
    return (
        (a.image.pixels == b.image.pixels).all()
        and (a.field.values == b.field.values).all()
        and (a.target_now == b.target_now).all()
        and str(a.readouts) == str(b.readouts)
        and (a.time_s, a.breath, a.tissue, a.number) == (b.time_s, b.breath, b.tissue, b.number)
        and (a.response is None) == (b.response is None)
        and (a.response is None or a.response.state == b.response.state)
    )


def test_off_is_as_if_there_were_no_time(scene):
    plain, told = Session(make_scene(SceneFile.parse(SMALL))), Session(scene)
    for share in (0.2, 0.6, 1.0, 1.0):
        a, b = plain.step(needles=one(share)), told.step(needles=one(share), tissue=TissueSettings(), dt=0.1)
        assert same(a, replace(b, time_s=a.time_s))
        assert b.undeformed == b.needles and b.by_needles is b.field and not b.moves
    assert b.time_s == pytest.approx(0.4)


def test_breath_moves_tissue_with_the_needle_out(breathing, scene):
    frame, rest = breathing.last, scene.targets["vessel"]
    assert frame.readouts.excursion == Breathing(excursion_mm=frame.breath.breathing.excursion_mm).excursion(1.5) > 0.5
    assert frame.readouts.moved == pytest.approx(0.65 * frame.readouts.excursion, rel=0.15)
    assert (frame.target_now - rest)[0] > 0.3, "towards the feet"
    assert frame.field.displacement(rest) == pytest.approx(frame.target_now - rest, abs=0.02)
    still = Session(scene).step()
    assert (frame.image.pixels != still.image.pixels).mean() > 0.1
    vertices = scene.deformed(frame.field, grid=False) - scene.deformed(still.field, grid=False)
    assert np.linalg.norm(vertices, axis=1).max() > 0.5
    assert frame.moves and frame.settled


def test_the_needle_is_taken_back_to_rest_and_its_field_carried_along(breathing, scene):
    session = Session(scene)
    session.resume(breathing.last)
    frame = session.step(needles=one(), dt=0.1)
    background = session._breathing(session.last.tissue).at(frame.readouts.excursion)
    world, rest = frame.needle, frame.undeformed["needle"]
    assert background.forward(rest.tip) == pytest.approx(world.tip, abs=1e-4)
    assert np.linalg.norm(rest.tip - world.tip) > 0.3
    assert dict(frame.response.state.needles)["needle"] == rest
    carried = ss.CarriedField(frame.response.field, background)
    assert frame.target_now == pytest.approx(carried.forward(scene.targets["vessel"]), abs=1e-6)
    assert frame.field.values == pytest.approx(ss.CarriedField(frame.by_needles, background).on_grid(), abs=1e-6)
    assert not np.allclose(frame.field.values, frame.by_needles.values + background.values, atol=1e-3), "not a sum"


def test_without_background_nothing_is_touched(scene):
    rest = Session(scene).rest
    assert composed(rest, None) is rest
    needles = one()
    assert needles_at_rest(None, needles) is needles


def test_a_needle_where_no_tissue_is_asks_nothing_of_the_model(breathing, scene):
    """Tissue beside the face towards the head has gone towards the feet."""
    session = Session(scene)
    session.resume(breathing.last)
    low = scene.tissue.grid.world(np.zeros(3))
    beside = ss.Needle(np.add(low, (3, 30, 0)), np.add(low, (0.05, 30, 12)))
    frame = session.step(needles={"needle": beside})
    assert frame.needles["needle"] == beside and frame.undeformed == {}
    assert frame.response is None and frame.readouts.hub.axial_n == 0


@pytest.mark.parametrize("contact", ["pose", "track"])
def test_whoever_has_a_frame_goes_on_bit_for_bit(scene, contact):
    session, other = Session(scene), Session(scene)
    session.step(tissue=TissueSettings(contact=contact, breathing="free"))
    for share in (0.2, 0.5):
        frame = session.step(needles=one(share), dt=0.3)
    frame = session.step(tissue=TissueSettings(contact=contact, breathing="held"), dt=0.3)
    other.resume(pickle.loads(pickle.dumps(frame)))
    for share in (0.7, 0.4):
        assert same(session.step(needles=one(share), dt=0.2), other.step(needles=one(share), dt=0.2))
    before = session.last
    session.step(needles=one(0.9), dt=5.0)
    session.resume(before)
    assert same(session.step(needles=one(0.1), dt=0.2), other.step(needles=one(0.1), dt=0.2))


def test_a_needle_that_remembers_drags_tissue_outward(scene):
    session = Session(scene)
    forces = []
    for share in (0.2, 0.4, 0.6, 0.8, 1.0, 0.8, 0.6):
        frame = session.step(needles=one(share), tissue=TissueSettings(contact="track"), dt=0.2)
        forces.append(frame.readouts.hub.axial_n)
    assert forces[4] > 0 > forces[6]
    again = session.step(tissue=TissueSettings(), dt=0.2)
    assert again.readouts.hub.axial_n > 0, "by its pose alone it presses"


def test_models_without_time_heed_none_of_it(scene):
    asked, plain = Session(scene, model="kelvinlet"), Session(scene, model="kelvinlet")
    told = TissueSettings(contact="track", breathing="free")
    for share in (0.3, 1.0):
        a, b = asked.step(needles=one(share), tissue=told, dt=1.0), plain.step(needles=one(share), dt=1.0)
        assert same(replace(a, tissue=b.tissue), b)
    assert (a.breath, a.tissue, a.readouts.hub) == (None, told, None)
    asked.switch("elastic")
    assert asked.step(dt=0.1).breath.began_s == asked.last.time_s, "who breathes begins at rest"


def test_the_hub_feels_the_forces_and_their_moment(scene):
    frame = Session(scene).step(needles=one(), tissue=TissueSettings(contact="track"), dt=0.1)
    force, needle = frame.forces["needle"], frame.needle
    hub = needle.tip - scene.spec.needle.length_mm * needle.direction
    moment = force.moment_nmm + np.cross(needle.tip - hub, force.force_n)
    assert frame.readouts.hub.axial_n == force.axial_n and frame.readouts.hub.lateral_n == force.lateral_n
    assert frame.readouts.hub.moment_nmm == pytest.approx(np.linalg.norm(moment), abs=1e-9)
    assert Session(scene).step().readouts.hub.axial_n == 0


def test_bone_is_touched_once_and_then_blocks():
    scene = make_scene("kidney")
    session = Session(scene, model="kelvinlet")
    rib = np.argwhere(
        scene.tissues.labels.voxels == next(n for n, name in scene.tissues.labels.names.items() if name == "bone")
    )
    there = scene.tissues.labels.lattice.world(rib[len(rib) // 2][None] * scene.tissues.labels.lattice.spacing)[0]
    needles = {"needle": ss.Needle((*there[:2], 0.0), (*there[:2], there[2] + 10))}
    first, second = session.step(needles=needles), session.step(needles=needles)
    assert [type(event) for event in first.events] == [Blocked, Touched]
    assert str(first.events[1]) == 'touched "bone"'
    assert [type(event) for event in second.events] == [Blocked]
    session.step(needles={})
    assert Touched("needle", "bone") in session.step(needles=needles).events


def test_events_are_kept_in_words_of_frames_that_nobody_saw_too(scene):
    console = Console(Session(scene))
    said = {2: (Punctured("needle", "skin", 2.77), Blocked("needle", "rib", 3.0)), 3: (Left("needle", "skin"),)}
    step = console.session.step

    def with_events(**asked):
        frame = step(**asked)
        console.session.last = replace(frame, events=said.get(frame.number, ()))
        return console.session.last

    console.session.step = with_events
    for depth in (0.0, 10.0, 20.0, 30.0, 40.0):
        frame = console.step(console.command.with_needle(depth=depth))
    assert [(event.number, event.text, event.depth) for event in frame.log] == [
        (1, 'punctured "skin" at 2.8 N', 20.0), (2, 'left "skin"', 30.0),
    ]  # fmt: skip
    console.reset()
    assert console.step().log == frame.log, "numbers go on"
    many = logged((), [f"event {k}\n of another model " + 200 * "x" for k in range(20)], 1.0)
    assert [event.number for event in many] == list(range(13, 21))
    assert all(len(event.text) == 100 and "\n" not in event.text for event in many)


CALM = Breath(Breathing(Spread(15, 0, 15, 15), Spread(17, 0, 17, 17)), began_s=0.0)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["none", "free", "held"]), st.floats(0.01, 6.0)), max_size=12))
def test_breath_is_held_released_and_ended_without_a_jump(asked):
    breath, now = CALM, 0.0
    fastest = 2 * np.pi * 17 / 4 + 5.6 * 1.5 / 2 + 5.6 / 24
    """mm/s: of a breath of 17 mm in 4 s (its steepest is 1.3 pi / 4 of the height) and of a drift that goes back."""
    for how, wait in asked:
        before = breath.excursion_mm(now) if breath else 0.0
        breath = breath.asked(how, now) if breath else None
        if breath is None:
            assert before == pytest.approx(0, abs=1e-9)
            return
        assert breath.excursion_mm(now) == pytest.approx(before, abs=1e-9)
        times = np.linspace(now, now + wait, 12)
        found = np.array([breath.excursion_mm(t) for t in times])
        assert np.abs(np.diff(found)).max() <= fastest * wait / 11 + 1e-9
        now += wait
    ended = breath.asked("none", now)
    assert ended is None or ended.excursion_mm(now + 30) == 0
    assert ended is None or ended.asked("none", now + 30) is None


def test_a_thousand_breath_holds_are_no_more_than_one():
    breath, now = CALM, 0.0
    for _ in range(1100):
        breath = breath.asked("held", now)
        breath = breath.asked("free", now + 3)
        now += 10
    assert len(breath.breathing.holds) == 1
    assert 0 <= breath.excursion_mm(now) <= 17


def test_the_breath_that_is_drawn_ends_at_rest():
    breathing = Breathing(seed=4)
    for t in (0.0, 1.0, 7.5, 40.0):
        end = breathing.rests_at(t)
        assert t < end < t + 60 / 9 and breathing.excursion(end) == pytest.approx(0, abs=1e-9)
        between = breathing.excursion(np.linspace(t + 1e-3, end - 0.05, 50))
        assert between.min() > 0, "and no earlier"
    held = breathing.held(1.0, drift_mm=0)
    assert held.is_held and not held.released(5.0).is_held
    assert held.released(5.0).rests_at(2.0) == pytest.approx(breathing.rests_at(1.0) + 4)
    with pytest.raises(ValueError, match="the breath is held from 1 s on; release it first"):
        held.rests_at(2.0)


def test_a_runner_goes_on_while_somebody_breathes(scene):
    console, enough = Console(Session(scene)), threading.Event()
    seen = []

    def look(frame, stamp):
        seen.append(frame)
        if len(seen) == 12:
            enough.set()

    with Runner(console) as runner:
        runner.subscribe(look)
        runner.submit(console.scene.start.with_tissue(breathing="free"), 1)
        assert enough.wait(60)
    assert len({frame.readouts.excursion for frame in seen}) > 8
    assert all(frame.command.tissue.breathing in ("none", "free") for frame in seen)


def test_a_command_without_a_word_of_time_is_as_the_scene_starts():
    text = SMALL.replace("[model]\n", '[model]\ncontact = "track"\n') + BREATHING + "breathes = true\n"
    console = Console(Session(make_scene(SceneFile.parse(text))))
    frame = console.step(replace_tissue(console.command, None))
    assert frame.command.tissue == TissueSettings(contact="track", breathing="free")
    assert frame.readouts.excursion == 0
    assert console.step(dt=1.0).readouts.excursion > 0.1  # somebody breathes in


def replace_tissue(command, tissue):
    from msgspec.structs import replace

    return replace(command, tissue=tissue)


def test_the_words_are_the_models():
    options = {option.name: option for option in registry.spec("elastic").options}
    for contact in options["contact"].choices:
        TissueSettings(contact=contact)
    for relaxation in options["relaxation"].choices:
        TissueSettings(contact="track", relaxation=relaxation)


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda: TissueSettings(breathing="deep"), "breathing = 'deep' is not known; choose one of none, free, held"),
        (lambda: TissueSettings(relaxation="tissue"), "relaxation = 'tissue' is for needles that leave a track; give"),
        (lambda: Session("gel").step(tissue=ALIVE), "tissue.breathing = 'free' is not for this scene; give its file a"),
        (lambda: Session("gel").step(tissue="free"), "tissue = 'free' is not TissueSettings; make one"),
    ],
)
def test_what_tissue_cannot_do_is_said_in_a_line(act, said):
    with pytest.raises(ValueError) as error:
        act()
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_breath_deeper_than_the_box_changes_nothing(scene):
    deep = make_scene(SceneFile.parse(SMALL + BREATHING.replace("0.2", "2.0")))
    session = Session(deep)
    first = session.step(needles=one(0.5))
    with pytest.raises(ValueError, match=r"breathing.excursion_mm reaches 63\.\d+ mm, at which tissue in a box of"):
        session.step(tissue=ALIVE, dt=0.1)
    assert session.last is first


def test_a_scene_file_that_relaxes_without_tracks_is_refused_where_it_says_so():
    with pytest.raises(SceneError) as error:
        SceneFile.parse(SMALL.replace("[model]\n", '[model]\nrelaxation = "tissue"\n'))
    assert "line 10: model.relaxation = 'tissue' is for needles that leave a track" in str(error.value)

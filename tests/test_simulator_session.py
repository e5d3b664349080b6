"""The session in world poses: what a step is given, what it leaves as it is, and steps that fail."""

import pickle
import threading
from dataclasses import dataclass

import numpy as np
import pytest

import sonospline as ss
from simulator_scenes import SMALL
from sonospline import _core, models
from sonospline.geometry import facing
from sonospline.models import registry
from sonospline.simulator import Console, SceneFile, Session, SimulatedFrame, make_scene
from sonospline.simulator.imaging import SyntheticImager

ENTRY = (26.0, 30.0, 0.0)
MODELS = ("paper", "kelvinlet", "elastic")


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL))


@pytest.fixture
def session(scene):
    return Session(scene, model="kelvinlet")


def needle(depth):
    return ss.Needle(ENTRY, np.add(ENTRY, depth * np.array([0.8, 0, 0.6])))


def one(depth):
    return {"needle": needle(depth)}


def pose(sweep=0.0):
    return facing((60, 30 + sweep, 0), depth=(0, 0, 1), right=(1, 0, 0))


def same(a, b):
    """Whether two frames are equal bit for bit."""
    return (
        a.number == b.number
        and (a.image.pixels == b.image.pixels).all()
        and (a.field.values == b.field.values).all()
        and (a.target_now == b.target_now).all()
        and (a.readouts == b.readouts or str(a.readouts) == str(b.readouts))
        and (a.response is None) == (b.response is None)
        and (a.response is None or a.response.state == b.response.state)
    )


def test_what_is_not_given_stays(session):
    first = session.step()
    assert (first.needles, first.settings) == ({}, session.scene.start.image)
    assert first.probe_to_reference[:3, 3] == pytest.approx([60, 30, 0])
    session.step(needles=one(20.0))
    session.step(probe_to_reference=pose(sweep=3.0))
    louder = session.scene.start.with_image(gain=6.0).image
    last = session.step(settings=louder)
    assert last.needle.depth == pytest.approx(20)
    assert (last.probe_to_reference == pose(sweep=3.0)).all()
    assert last.settings == louder
    again = session.step()
    assert (again.needles, again.settings) == (last.needles, louder)
    assert again.response is last.response  # tissue at rest is not asked again
    assert (again.image.pixels != last.image.pixels).any()  # noise lives
    assert [first.number, last.number, again.number] == [0, 3, 4]


def test_a_frame_is_the_consoles_at_the_same_poses(scene):
    """The knobs are an adapter: same poses, same bits."""
    console, session = Console(Session(scene, model="paper")), Session(scene, model="paper")
    console.step()
    session.step()
    for depth, sweep, gain in ((10.0, 0.0, 0.0), (30.0, 1.0, 3.0), (0.0, 1.0, 3.0)):
        command = scene.start.with_needle(depth=depth).with_probe(sweep=sweep).with_image(gain=gain)
        shown = console.step(command)
        placed = scene.frame.needle(command.needle)
        place = scene.frame.probe_to_reference(command.probe, scene.spec.probe.press_mm)
        frame = session.step(
            needles={} if placed is None else {"needle": placed}, probe_to_reference=place, settings=command.image
        )
        assert (frame.image.pixels == shown.image.pixels).all()
        assert (frame.field.values == shown.field.values).all()
        assert frame.readouts.moved == shown.readouts.moved
    assert np.isnan(frame.readouts.tip_to_target)  # a session knows no place for a needle that is out
    assert shown.readouts.tip_to_target > 0


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_the_field_is_the_models(scene, model):
    session, alone = Session(scene, model=model), models.make(model, scene.tissue, needs=())
    session.step(needles=one(15.0), dt=1 / 60)
    frame = session.step(needles=one(25.0), dt=1 / 60)
    if model != "elastic":  # that one is labelled here
        state = alone.step(alone.rest, one(15.0)).state
        assert (ss.GridField.of(alone.step(state, one(25.0)).field).values == frame.field.values).all()
    assert frame.field.error_estimate == frame.response.error_estimate
    assert frame.readouts.moved > 0


def test_forces_and_several_needles_come_from_the_model(scene):
    session = Session(scene)
    two = {"biopsy": needle(30.0), "anchor": ss.Needle((90, 30, 0), (90, 30, 20))}
    frame = session.settle(needles=two)
    assert set(frame.forces) == {"biopsy", "anchor"}
    assert frame.forces["anchor"].axial_n > 0
    assert frame.needle is two["biopsy"]  # the first one named
    assert frame.readouts.depth == pytest.approx(30)
    swapped = Session(scene).settle(needles=dict(reversed(two.items())))
    assert (swapped.field.values == frame.field.values).all()
    assert swapped.readouts.depth == pytest.approx(20)
    left = session.settle(needles={"anchor": two["anchor"]})
    assert set(left.forces) == {"anchor"}
    assert session.step(needles={}).forces == {}
    session.switch("paper")
    with pytest.raises(ValueError, match="model = 'paper' cannot do forces; use model = 'elastic'"):
        session.step(needles=one(20.0)).forces["needle"]


BAD = {
    "outside": ({"needles": {"needle": ss.Needle(ENTRY, (60, 30, 200))}}, "tip = .* lies outside the tissue"),
    "two": ({"needles": one(10.0) | {"b": needle(12.0)}}, "cannot do several needles .*2 are given.*'elastic'"),
    "no name": ({"needles": needle(10.0)}, 'has no names; give {"needle": Needle'),
    "a number for a name": ({"needles": {3: needle(10.0)}}, "needles has 3"),
    "no needle": ({"needles": {"needle": (1, 2, 3)}}, "needles has 'needle'"),
    "sheared": ({"probe_to_reference": np.eye(4) + np.eye(4, k=1)}, "probe_to_reference is not rigid"),
    "3 x 3": ({"probe_to_reference": np.eye(3)}, "probe_to_reference has shape"),
    "a pose of NaN": ({"probe_to_reference": np.full((4, 4), np.nan)}, "NaN"),
    "settings": ({"settings": (1, 2)}, "settings = .* is not ImageSettings"),
    "backwards": ({"dt": -0.1}, "dt = -0.1 is out of range"),
    "NaN seconds": ({"dt": float("nan")}, "dt = nan is out of range"),
    "endless": ({"dt": float("inf")}, "dt = inf is out of range"),
}


@pytest.mark.parametrize(("bad", "says"), BAD.values(), ids=BAD)
def test_what_cannot_be_is_refused_and_leaves_no_trace(scene, bad, says):
    session, twin = Session(scene, model="kelvinlet"), Session(scene, model="kelvinlet")
    before = session.step(needles=one(10.0))
    twin.step(needles=one(10.0))
    with pytest.raises(ValueError, match=says) as caught:
        session.step(**bad)
    assert "\n" not in str(caught.value)
    assert session.last is before
    assert same(session.step(needles=one(20.0)), twin.step(needles=one(20.0)))


def test_settings_beyond_the_scenes_are_refused(session):
    with pytest.raises(ValueError, match=r"image.depth = 900 is out of range; give 20 to 48 in this scene"):
        session.step(settings=session.scene.start.with_image(depth=900).image)
    assert session.last is None


def broken(*_, **__):
    raise RuntimeError("injected")


def break_model(patch, session):
    patch.setattr(next(iter(session._models.values())), "_answer", broken)


def break_imager(patch, session):
    patch.setattr(SyntheticImager, "render", broken)


def break_aim(patch, session):
    patch.setattr(SyntheticImager, "aimed", broken)


def break_sampling(patch, session):
    patch.setattr(ss.GridField, "of", broken)


def break_core(patch, session):
    solving = {"paper": "kernel_matrix", "kelvinlet": "kelvinlet_sum", "elastic": "nodal_forces"}
    patch.setattr(_core.active, solving[session.model], broken)


@pytest.mark.parametrize("model", [pytest.param(m, marks=() if m == "elastic" else pytest.mark.slow) for m in MODELS])
@pytest.mark.parametrize(
    "how",
    [
        break_model,
        break_imager,
        *(pytest.param(how, marks=pytest.mark.slow) for how in (break_aim, break_sampling, break_core)),
    ],
)
def test_a_step_that_fails_leaves_no_trace(scene, model, how, monkeypatch):
    """The frames after it are those of a session that never failed, bit for bit."""
    session, twin = Session(scene, model=model), Session(scene, model=model)
    for each in (session, twin):
        each.step(needles=one(12.0))
        before = each.step(needles=one(18.0), probe_to_reference=pose(sweep=1.0))
    before = session.last
    with monkeypatch.context() as patch:
        how(patch, session)
        for _ in range(2):
            with pytest.raises(RuntimeError, match="injected"):
                session.step(needles=one(40.0), probe_to_reference=pose(sweep=-4.0))
    assert session.last is before
    for depth, sweep in ((24.0, 1.0), (30.0, 2.0), (5.0, 2.0)):
        poses = {"needles": one(depth), "probe_to_reference": pose(sweep=sweep)}
        assert same(session.step(**poses), twin.step(**poses))
    assert same(session.step(needles={}), twin.step(needles={}))


@pytest.mark.parametrize("model", MODELS)
def test_a_session_goes_back_to_any_frame(scene, model):
    session = Session(scene, model=model)
    frames = [session.step(needles=one(depth), dt=1 / 60) for depth in (10.0, 20.0, 30.0, 15.0)]
    session.step(needles={}, probe_to_reference=pose(sweep=5.0))
    session.resume(frames[1])
    assert all(same(session.step(needles=one(d), dt=1 / 60), f) for d, f in zip((30.0, 15.0), frames[2:], strict=True))
    session.resume(pickle.loads(pickle.dumps(frames[0])))
    assert same(session.step(needles=one(20.0), dt=1 / 60), frames[1])
    session.resume(None)
    assert same(session.step(needles=one(10.0), dt=1 / 60), frames[0])
    other = Session(scene, model=model)
    other.resume(frames[2])
    assert same(other.step(needles=one(15.0), dt=1 / 60), frames[3])


def test_a_frame_of_another_scene_is_refused(session):
    other = Session(make_scene(SceneFile.parse(SMALL.replace("nodes = 6000", "nodes = 5000"))), model="kelvinlet")
    session.resume(other.step(needles=one(10.0)))
    with pytest.raises(ValueError, match=r"state is of model 'kelvinlet' .*start from this model's rest"):
        session.step(needles=one(20.0))
    with pytest.raises(ValueError, match="frame = 3 is not a SimulatedFrame"):
        session.resume(3)


def test_another_model_goes_on_from_rest_at_the_same_poses(scene):
    session = Session(scene, model="paper")
    session.step(needles=one(20.0))
    session.switch("kelvinlet")
    frame = session.step()
    assert frame.model == "kelvinlet"
    assert (frame.field.values == Session(scene, model="kelvinlet").step(needles=one(20.0)).field.values).all()
    with pytest.raises(ValueError, match="model = 'magic' is not known; choose one of paper"):
        session.switch("magic")


def test_warming_up_changes_nothing(scene):
    warm, cold = Session(scene), Session(scene)
    warm.warm_up(needle(3.0))
    assert warm.last is None
    for depth in (10.0, 25.0):
        assert same(warm.step(needles=one(depth)), cold.step(needles=one(depth)))


@pytest.mark.slow
def test_warming_up_beside_a_session_at_work_changes_nothing(scene):
    warm, cold = Session(scene), Session(scene)
    helpers = [threading.Thread(target=warm.warm_up, args=(needle(3.0),)) for _ in range(3)]
    for helper in helpers:
        helper.start()
    for depth in (0.5, 10.0, 25.0):
        assert same(warm.step(needles=one(depth)), cold.step(needles=one(depth)))
    for helper in helpers:
        helper.join(60)
    assert same(warm.step(needles=one(30.0)), cold.step(needles=one(30.0)))


class Relaxing(models.TissueModel):
    """Moves at once as a needle is put in, and goes half the way back every second once it is out."""

    name = "relaxing"
    capabilities = frozenset({"time"})

    def _answer(self, state, needles, dt):
        last = getattr(state, "moved", 0.0)
        moved = 2.0 if needles else last * 0.5**dt
        moved = moved if moved > 0.1 else 0.0
        field = ss.GridField(self.tissue.grid, np.full((*self.tissue.grid.shape, 3), moved, np.float32))
        inside = Relaxed(self.identity, tuple(needles.items()), moved=moved)
        return models.Response(state=inside, field=field, forces={}, settled=bool(needles) or moved == 0)


@dataclass(frozen=True, eq=False, repr=False)
class Relaxed(models.State):
    moved: float = 0.0


def registered(monkeypatch, kind):
    monkeypatch.setattr(registry, "_table", dict(registry._discover()))
    spec = models.ModelSpec(name=kind.name, title="", summary="", maker=lambda tissue, materials: kind(tissue))
    registry.register(spec)


def test_tissue_that_takes_its_time_is_stepped_until_it_is_at_rest(scene, monkeypatch):
    """After the needle is out, too; and a frame's state is enough to live that again."""
    registered(monkeypatch, Relaxing)
    session = Session(scene, model="relaxing")
    frames = [session.step(needles=one(20.0), dt=0.5)]
    frames += [session.step(needles={}, dt=1.0) for _ in range(6)]
    assert [f.field.values.max() for f in frames] == [2, 1, 0.5, 0.25, 0.125, 0, 0]
    assert [f.settled for f in frames] == [True, False, False, False, False, True, True]
    assert (frames[2].needle, frames[2].readouts.moved) == (None, pytest.approx(0.5 * 3**0.5))
    session.resume(frames[1])
    assert session.step(dt=2.0).field.values.max() == 0.25


def test_a_model_of_another_package_answers_here(scene, monkeypatch):
    """One that registers itself is a model of scenes, too: nothing here names the models."""

    class Stiff(models.TissueModel):
        name = "stiff"

        def _answer(self, state, needles, dt):
            values = np.zeros((*self.tissue.grid.shape, 3), np.float32)
            field = ss.GridField(self.tissue.grid, values, error_estimate=0.0)
            inside = models.State(self.identity, tuple(needles.items()))
            return models.Response(state=inside, field=field, forces={}, events=("touched bone",))

    registered(monkeypatch, Stiff)
    frame = Session(scene, model="stiff").step(needles=one(20.0))
    assert (frame.model, frame.events, frame.readouts.moved) == ("stiff", ("touched bone",), 0.0)


def test_a_frame_says_briefly_what_it_is(session):
    frame = session.step(needles=one(20.0))
    assert isinstance(frame, SimulatedFrame)
    rows, columns = frame.image.pixels.shape
    assert repr(frame) == f"SimulatedFrame(0, kelvinlet, needle: 20 mm, {rows} x {columns} pixels)"

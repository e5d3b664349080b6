"""Copies and pickles go on to the same bits as what they were made of, and share nothing that changes with it."""

import copy
import multiprocessing
import pickle

import numpy as np
import pytest

import sonospline as ss
from simulator_scenes import SMALL
from sonospline.fem import FiniteElementModel
from sonospline.geometry import facing
from sonospline.mechanics import LineForce, labelled_cube
from sonospline.models.elastic import ElasticInsertion
from sonospline.simulator import Console, SceneFile, Session
from sonospline.ultrasound import Display, NeedleEcho, Phantom, Probe, Scanner

HOWS = {"pickle": lambda thing: pickle.loads(pickle.dumps(thing)), "deepcopy": copy.deepcopy}
SIDE = 100.0


def tissue():
    return ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=SIDE / 8))


def needle(depth):
    return ss.Needle((0, 0.45 * SIDE, 0.5 * SIDE), (depth * SIDE, 0.55 * SIDE, 0.5 * SIDE))


def insertion_pulled_back():
    """Landmarks appended in several batches, some dropped, others on a new axis."""
    insertion = ss.Insertion(tissue())
    for depth in (0.2, 0.5, 0.3):
        insertion.advance(needle(depth))
    insertion.advance(ss.Needle((0, 0.5 * SIDE, 0.6 * SIDE), (30, 50, 60)))
    return insertion


def moving_mesh():
    model = ss.NeedleTissueModel.paper_incremental(SIDE)
    insertion = ss.Insertion(tissue(), model, accumulation="incremental")
    insertion.advance(needle(0.1))
    return insertion


def elastic():
    insertion = ElasticInsertion(tissue(), labelled_cube("layers", side=SIDE), nodes=9**3)
    insertion.advance(needle(0.2))
    return insertion


def advance(insertion):
    fields = [insertion.advance(needle(depth)) for depth in (0.3, 0.45, 0.6)]
    return np.stack([field.on_grid() for field in fields])


def scanner(phantom, probe_depth=30.0):
    probe = Probe.linear(depth_mm=probe_depth, lines=32, aperture_mm=30)
    return Scanner(phantom, probe, facing((20, 5, 2), depth=(0, 0, 1), right=(1, 0, 0)))


def look(phantom):
    return scanner(phantom).render().iq


def rendered(thing):
    look(thing)
    return thing


def a_scene():
    return Phantom.uniform("liver", size_mm=(40, 10, 40))


def used_scanner():
    made = scanner(a_scene())
    made.render()
    return made


def render(made):
    grid = ss.Grid(shape=(9, 5, 9), spacing=(5, 2.5, 5))
    field = ss.GridField(grid, np.full((*grid.shape, 3), 0.4, np.float32))
    turned = made.with_display(gain_db=-25.0).moved(facing((20, 5, 3), depth=(0, 0.1, 1), right=(1, 0, 0)))
    return np.stack([made.render(field, frame=3).iq, turned.render(field).iq])


def solved():
    model = FiniteElementModel(tissue(), solver="direct")
    model.solve(LineForce.for_cube(SIDE, 10), needle(0.3))
    return model


def solve(model):
    return model.solve(LineForce.for_cube(SIDE, 10), needle(0.5))


def small_session(model):
    session = Session(SceneFile.parse(SMALL), model=model)
    session.step(needles={"needle": ss.Needle((30, 30, 0), (45, 30, 12))})
    return session


def push(session):
    tips = (50, 30, 16), (55, 30, 20)
    return _seen([session.step(needles={"needle": ss.Needle((30, 30, 0), tip)}, dt=1 / 60) for tip in tips])


def small_console(model):
    console = Console(Session(SceneFile.parse(SMALL), model=model))
    console.step(console.command.with_needle(depth=20))
    return console


def turn(console):
    command = console.command
    return _seen([console.step(command.with_needle(depth=d).with_probe(slide=d / 10)) for d in (24, 30)])


def _seen(frames):
    return np.concatenate([part.ravel().astype(float) for f in frames for part in (f.image.pixels, f.field.values)])


THINGS = {
    "Insertion": (lambda: ss.Insertion(tissue()), advance),
    "Insertion under way": (insertion_pulled_back, advance),
    "Insertion, incremental": (moving_mesh, advance),
    "Insertion, all anchors": (lambda: ss.Insertion(tissue(), anchors="all"), advance),
    "KelvinletInsertion": (lambda: ss.KelvinletInsertion(tissue()), advance),
    "ElasticInsertion": (elastic, advance),
    "FiniteElementModel": (solved, solve),
    "Phantom": (a_scene, look),
    "Phantom rendered": (lambda: rendered(a_scene()), look),
    "Scanner": (used_scanner, render),
    "Session, paper": (lambda: small_session("paper"), push),
    "Session, elastic": (lambda: small_session("elastic"), push),
    "Console, kelvinlet": (lambda: small_console("kelvinlet"), turn),
    "Console, elastic": (lambda: small_console("elastic"), turn),
}


@pytest.fixture(autouse=True, scope="module")
def a_cache_of_its_own(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SONOSPLINE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.mark.parametrize("how", [HOWS["pickle"], pytest.param(copy.deepcopy, marks=pytest.mark.slow)], ids=HOWS)
@pytest.mark.parametrize(("make", "go_on"), THINGS.values(), ids=THINGS)
def test_a_copy_goes_on_to_the_same_bits_on_its_own(make, go_on, how):
    thing = make()
    twin, other = how(thing), how(thing)
    go_on(other)  # moves nothing of the first two
    assert np.array_equal(go_on(twin), go_on(thing))


@pytest.mark.usefixtures("backend")
def test_copies_hold_on_either_backend():
    insertion = insertion_pulled_back()
    assert np.array_equal(advance(copy.deepcopy(insertion)), advance(insertion))


@pytest.mark.slow
def test_another_process_goes_on_to_the_same_bits():
    names = [
        "Insertion under way",
        "KelvinletInsertion",
        "ElasticInsertion",
        "Phantom rendered",
        "Session, paper",
        "Console, elastic",
    ]
    things = [(THINGS[name][0](), THINGS[name][1]) for name in names]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        there = pool.map(_go_on, things)
    for name, (thing, go_on), found in zip(names, things, there, strict=True):
        assert np.array_equal(go_on(thing), found), name


def _go_on(pair):
    thing, go_on = pair
    return go_on(thing)


@pytest.mark.parametrize(
    "thing",
    [
        tissue(), tissue().grid, needle(0.5), ss.NeedleTissueModel.paper(), ss.DragModel.kelvinlet(),
        Probe.curvilinear(), NeedleEcho.trocar(), Display(), labelled_cube("layers"), SceneFile.parse(SMALL),
    ],
    ids=lambda thing: type(thing).__name__,
)  # fmt: skip
@pytest.mark.parametrize("how", HOWS.values(), ids=HOWS)
def test_parameters_are_copied_whole(thing, how):
    assert same(how(thing), thing)


FIELDS = {
    "KernelField": lambda: insertion_pulled_back().field,
    "ComposedField": lambda: moving_mesh().field,
    "GridField": lambda: elastic().field,
    "KelvinletField": lambda: ss.KelvinletInsertion(tissue()).solve(needle(0.4)),
}


@pytest.mark.parametrize("how", HOWS.values(), ids=HOWS)
@pytest.mark.parametrize("make", FIELDS.values(), ids=FIELDS)
def test_fields_are_copied_to_the_same_values(rng, make, how):
    field, points = make(), rng.random((20, 3)) * SIDE
    twin = how(field)
    assert np.array_equal(twin.displacement(points), field.displacement(points))
    assert np.array_equal(twin.on_grid(), field.on_grid())
    assert np.array_equal(twin.inverse(points), field.inverse(points), equal_nan=True)


def same(a, b):
    if isinstance(b, np.ndarray):
        return np.array_equal(a, b) and a.dtype == b.dtype
    if isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in b)
    return type(a) is type(b) and (same(vars(a), vars(b)) if hasattr(b, "__dict__") else a == b)

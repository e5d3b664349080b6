"""The one table of models: what it is asked for is checked once, and a refusal names value and remedy."""

import pickle
import re

import pytest

import sonospline as ss
from sonospline import models
from sonospline.mechanics import Material, labelled_cube
from sonospline.models import CapabilityError, ModelSpec, registry

TISSUE = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5))


@pytest.fixture
def an_open_table(monkeypatch):
    """The table, which forgets what a test adds to it."""
    models.names()
    monkeypatch.setattr(registry, "_table", dict(registry._table))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("jelly", {}, "model = 'jelly' is not known; choose one of paper, kelvinlet, elastic"),
        ("paper", {"drag_mm": 2}, "drag_mm is no option of model = 'paper'; it has kernel, smoothing, anchors"),
        ("kelvinlet", {"drag_mm": -1}, "drag_mm = -1 is out of range; give a number from 0 to 10000 mm"),
        ("kelvinlet", {"drag_mm": float("nan")}, "drag_mm = nan is not finite; give a finite number"),
        ("elastic", {"solver_nodes": 1.5}, "solver_nodes = 1.5 is not a whole number; give a whole number from 8"),
        ("elastic", {"solver_nodes": True}, "solver_nodes = True is not a whole number"),
        ("elastic", {"tolerance": 2}, "tolerance = 2 is out of range; give a number from 1e-05 to 1"),
        ("elastic", {"budget": 0}, "budget = 0 is out of range; give a whole number from 1 to 200"),
        (
            "paper",
            {"kernel": "thin plate"},
            "kernel = 'thin plate' is not known; choose one of biharmonic",
        ),
        (
            "paper",
            {"anchors": "most"},
            "anchors = 'most' is not a whole number; give a whole number from 2",
        ),
        ("paper", {"materials": "liver"}, "materials = 'liver' is none; give a Material, or a TissueMap"),
        ("paper", {"materials": labelled_cube("layers")}, "model = 'paper' cannot do labels; use model = 'elastic'"),
        ("kelvinlet", {"needs": ["forces"]}, "model = 'kelvinlet' cannot do forces; use model = 'elastic'"),
        ("kelvinlet", {"needs": ["several needles"]}, "cannot do several needles; use model = 'elastic'"),
        ("kelvinlet", {"needs": ["time"]}, "cannot do time; use model = 'elastic'"),
        ("elastic", {"needs": ["magic"]}, "needs = 'magic' is not known; choose one of forces, time, labels"),
    ],
)
def test_what_cannot_be_made_is_said_in_one_line(name, options, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        models.make(name, TISSUE, **options)
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 250
    if "cannot do" in message:
        assert isinstance(refused.value, CapabilityError)


def test_what_is_needed_and_can_be_done_is_made():
    model = models.make(
        "elastic",
        TISSUE,
        labelled_cube("layers", side=100),
        needs=["forces", "labels", "several needles"],
        solver_nodes=500,
    )
    assert model.capabilities == {"forces", "time", "labels", "several needles"}


def test_options_reach_the_models():
    paper = models.make("paper", TISSUE, kernel="triharmonic", anchors=3, max_landmarks=40, shaft_radius=30.0)
    assert (paper.max_landmarks, paper.needle_effect.shaft_radius) == (40, 30.0)
    assert paper.needle_effect.shaft_decay == ss.NeedleTissueModel.paper(100.0).shaft_decay
    assert isinstance(paper.kernel, ss.Triharmonic)
    kelvinlet = models.make("kelvinlet", TISSUE, Material(10, 0.3), drag_mm=1.5)
    assert (kelvinlet.drag.drag, kelvinlet.drag.kernel.poissons_ratio) == (1.5, 0.3)
    elastic = models.make("elastic", TISSUE, Material(25), solver_nodes=500, tolerance=0.01, budget=3)
    assert (elastic.solver.material.stiffness_kpa, elastic.tolerance, elastic.budget) == (25, 0.01, 3)


@pytest.mark.parametrize("name", models.names())
def test_defaults_are_in_range_and_live_ranges_within_them(name):
    for option in models.spec(name).options:
        assert option.help
        for end in option.live or ():
            assert option.check(end) == end


@pytest.mark.usefixtures("an_open_table")
def test_a_model_registered_here_is_made_like_any_other():
    made = models.make("kelvinlet", TISSUE)
    spec = ModelSpec(name="mine", title="Mine", summary="a copy", maker=lambda tissue, materials: made)
    models.register(spec)
    assert models.names()[-1] == "mine" and models.titles()["mine"] == "Mine"
    assert models.make("mine", TISSUE) is made
    with pytest.raises(ValueError, match="name = 'mine' is taken by another model"):
        models.register(spec)
    with pytest.raises(ValueError, match="spec = 3 is not a ModelSpec; make one"):
        models.register(3)


@pytest.mark.usefixtures("an_open_table")
def test_a_maker_that_makes_nonsense_is_said():
    models.register(ModelSpec(name="mine", title="", summary="", maker=lambda tissue, materials: 42))
    with pytest.raises(ValueError, match="model = 'mine' makes 42, which is not a TissueModel"):
        models.make("mine", TISSUE)


def test_errors_of_capability_travel_between_processes():
    error = pickle.loads(pickle.dumps(CapabilityError("paper", "forces", ["elastic"])))
    assert str(error) == "model = 'paper' cannot do forces; use model = 'elastic'"

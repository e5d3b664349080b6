"""First touch: force and displacement start from nothing, whatever the model, the face and the unit of length."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import sonospline as ss
from sonospline import models
from sonospline.mechanics import LineForce, Material, TissueForce, TissueMap, built_up, labelled_cube
from sonospline.mechanics.first_touch import BEVEL_MM, along_bevel
from sonospline.models.elastic import ElasticModel
from sonospline.simulator import make_scene

MODELS = ("paper", "kelvinlet", "elastic")
BOXES = {
    "mm, from x-": (100.0, "x-"),
    "mm, from y+": (100.0, "y+"),
    "unit, from x-": (1.0, "x-"),
    "unit, from z+": (1.0, "z+"),
}
BUILD_UP = 0.06
"""In sides."""


@lru_cache
def made(name, box):
    """A model in a box of a side, of which the needle comes to act over BUILD_UP of it."""
    side, face = BOXES[box]
    tissue = ss.Tissue(ss.Grid(shape=(13,) * 3, spacing=side / 12), face)
    if name != "elastic":
        return models.make(name, tissue, build_up_mm=BUILD_UP * side)
    unit = LineForce(build_up=BUILD_UP)
    load = LineForce(unit.friction * side, unit.tip_force * side**2, unit.width * side, unit.build_up * side)
    return ElasticModel(tissue, Material(), load, nodes=11**3)


def pushed(tissue, place, aside, depth):
    """A needle so deep, in sides, that enters the free face at a place and points inward, more or less."""
    axis, end = divmod(ss.FACES.index(tissue.entry_face), 2)
    entry, direction = np.insert(place, axis, end), np.insert(aside, axis, -1.0 if end else 1.0)
    direction = direction / np.linalg.norm(direction)
    return ss.Needle(*(tissue.grid.world(point * tissue.grid.side) for point in (entry, entry + depth * direction)))


def field_of(model, needle):
    response = model.step(model.rest, {"needle": needle})
    return model.settle(response, tolerance=1e-3).field if model.name == "elastic" else response.field


def largest(values):
    return float(np.linalg.norm(values, axis=-1).max())


places = st.tuples(st.floats(0.25, 0.75), st.floats(0.25, 0.75))
slants = st.tuples(st.floats(-1, 1), st.floats(-1, 1))


def test_it_builds_up_smoothly_and_never_comes_down():
    depths = np.linspace(0, 12, 12_001)
    share = np.array([built_up(depth, 6) for depth in depths])
    slope = np.diff(share) / np.diff(depths)
    assert (share[0], share[6000], share[-1]) == (0.0, 1.0, 1.0)
    assert slope.min() >= 0 and slope.max() <= 1.5 / 6 + 1e-9
    assert slope[0] < 1e-3 and np.abs(np.diff(slope)).max() < 2e-4


@pytest.mark.parametrize("name", MODELS)
def test_a_slow_first_push_starts_from_nothing(name):
    model, depths = made(name, "mm, from y+"), BUILD_UP * np.array([1e-6, 1e-3, 1e-2, 0.1, 0.5, 1])
    moved = [largest(field_of(model, pushed(model.tissue, (0.4, 0.5), (0.3, -0.2), d)).on_grid()) for d in depths]
    assert np.all(np.diff([0.0, *moved]) > 0)
    assert np.all(np.diff([0.0, *moved]) <= np.diff([0.0, *depths]) * model.tissue.grid.side)
    assert moved[2] < 3e-3 * moved[-1] and moved[-1] > 1


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("box", BOXES)
@given(place=places, aside=slants, depth=st.floats(-9, 0))
def test_no_tissue_moves_further_than_the_tip_has_come(name, box, place, aside, depth):
    model, sides = made(name, box), BUILD_UP * 10.0**depth
    moved = largest(field_of(model, pushed(model.tissue, place, aside, sides)).on_grid())
    assert moved <= 1.001 * sides * model.tissue.grid.side


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kelvinlet", "elastic"])
@pytest.mark.parametrize("box", BOXES)
@given(place=places, aside=slants, depth=st.floats(0.001, 0.4), step=st.floats(-5, -2))
def test_tissue_moves_no_faster_than_the_needle(name, box, place, aside, depth, step):
    model, before = made(name, box), depth - 10.0**step
    assume(before > 0)
    shallow, deep = (field_of(model, pushed(model.tissue, place, aside, d)).on_grid() for d in (before, depth))
    unsettled = 3e-5 if name == "elastic" else 1e-9
    assert largest(deep - shallow) <= ((depth - before) + unsettled) * model.tissue.grid.side


@pytest.mark.parametrize(
    "depth", [9.0, *(pytest.param(depth, marks=pytest.mark.slow) for depth in (3.0, 6.0, 15.0, 20.0))]
)
def test_the_surface_of_soft_tissue_follows_the_tip_and_does_not_run_ahead_of_it(depth):
    """The load is on the tissue that the needle is in: on its surface, all of it, until that is pierced."""
    model = ElasticModel(ss.Tissue(ss.Grid(shape=(25,) * 3, spacing=100 / 24), "x-"), Material(5))
    needle = ss.Needle((0, 50, 50), (depth, 50, 50))
    moved = largest(model.settle(model.step(model.rest, {"needle": needle}), tolerance=1e-2).field.on_grid())
    assert 0.45 * depth < moved < depth


@pytest.mark.slow
def test_the_skin_of_the_kidney_scene_follows_the_tip_and_does_not_run_ahead_of_it():
    scene = make_scene("kidney")
    model = ElasticModel(scene.tissue, scene.tissues)
    entry = scene.frame.entry(scene.start.needle)
    way, state = ss.Needle(entry, scene.targets["lower calyx"]), model.rest
    for depth in range(1, 25):
        response = model.step(state, {"needle": ss.Needle(entry, entry + depth * way.direction)})
        state = response.state
        assert largest(response.field.on_grid()) < depth


@pytest.mark.parametrize("name", MODELS)
def test_without_a_needle_nothing_moves_and_a_needle_of_no_length_is_refused(name):
    model = made(name, "mm, from x-")
    inside = model.step(model.rest, {"needle": pushed(model.tissue, (0.5, 0.5), (0, 0), 0.3)})
    out = model.step(inside.state, {})
    assert largest(out.field.on_grid()) == 0.0
    with pytest.raises(ValueError, match="equals the entry; move the tip off"):
        ss.Needle((0, 50, 50), (0, 50, 50))


@pytest.mark.parametrize("name", MODELS)
def test_the_way_out_ends_as_the_way_in_began(name):
    model, within = made(name, "mm, from x-"), 0.05 if name == "elastic" else 1e-6
    state = model.rest
    for depth in (0.3, 0.06, 0.03, 0.01, 1e-3, 1e-4):
        needle = {"needle": pushed(model.tissue, (0.4, 0.5), (0.2, 0.1), depth)}
        out = model.step(state, needle)
        state, on_way_in = out.state, field_of(model, needle["needle"]).on_grid()
        assert largest(out.field.on_grid() - on_way_in) <= 2 * within * largest(on_way_in)


def test_a_second_needle_touches_as_gently_as_the_first():
    model = made("elastic", "mm, from x-")
    deep, touches = (
        pushed(model.tissue, place, (0, 0), depth) for place, depth in (((0.4, 0.5), 0.4), ((0.7, 0.5), 1e-4))
    )
    alone = model.settle(model.step(model.rest, {"deep": deep}), tolerance=1e-4)
    both = model.settle(model.step(alone.state, {"deep": deep, "touches": touches}), tolerance=1e-4)
    assert largest(both.field.on_grid() - alone.field.on_grid()) <= 0.01 + 3e-4 * largest(alone.field.on_grid())
    assert both.forces["deep"] == alone.forces["deep"] and 0 < both.forces["touches"].axial_n < 1e-3


@pytest.mark.parametrize("name", MODELS)
def test_deep_in_nothing_differs(name):
    """The printed form of the paper, to the bit: what has been built up is whole."""
    tissue = ss.Tissue(ss.Grid(shape=(13,) * 3, spacing=100 / 12))
    small = {"solver_nodes": 9**3} if name == "elastic" else {}
    at_once, gentle = (models.make(name, tissue, **small, **option) for option in ({"build_up_mm": 0.0}, {}))
    for depth, same in ((0.02, False), (0.31, True), (0.6, True)):
        needle = pushed(tissue, (0.45, 0.5), (0.1, 0.2), depth)
        first, second = (model.step(model.rest, {"needle": needle}).field.on_grid() for model in (at_once, gentle))
        assert np.array_equal(first, second) == same


def test_the_registry_starts_gently_and_the_printed_form_is_the_papers_class():
    tissue = ss.Tissue(ss.Grid(shape=(13,) * 3, spacing=100 / 12))
    assert models.make("paper", tissue).build_up == pytest.approx(2 * 2.66)
    assert models.make("paper", tissue, tip_displacement=4.0).build_up == pytest.approx(8.0)
    assert models.make("kelvinlet", tissue).drag.build_up == pytest.approx(2 * 2.79)
    assert models.make("elastic", tissue, solver_nodes=500).load.build_up == 30.0
    printed = (ss.Insertion(tissue).tissue_model, models.make("paper", tissue, accumulation="incremental"))
    assert [model.build_up for model in printed] == [0.0, 0.0]
    touch = ss.Needle((0, 50, 50), (0.01, 50, 50))
    assert largest(ss.Insertion(tissue).advance(touch).on_grid()) > 2
    gentle = models.make("paper", tissue)
    assert largest(gentle.step(gentle.rest, {"needle": touch}).field.on_grid()) < 1e-4


@pytest.mark.parametrize("bad", [-1, np.nan, np.inf, "deep"])
def test_a_bad_depth_is_refused(bad):
    tissue = ss.Tissue(ss.Grid(shape=(9,) * 3, spacing=12.5))
    for make in (
        lambda: LineForce(build_up=bad),
        lambda: TissueForce(labelled_cube("layers"), build_up=bad),
        lambda: ss.Insertion(tissue, build_up=bad),
        lambda: ss.DragModel.kelvinlet(build_up=bad),
        *(lambda name=name: models.make(name, tissue, build_up_mm=bad) for name in MODELS),
    ):
        with pytest.raises(ValueError, match=r"build_up(_mm)? = "):
            make()


@given(depth=st.floats(1e-9, 200))
def test_a_tip_meets_the_tissue_that_its_bevel_is_in(depth):
    places, shares = along_bevel(depth)
    assert shares.sum() == pytest.approx(1, abs=1e-12)
    assert shares.min() >= -1e-12 and places.max() <= depth and places.min() >= max(0.0, depth - 1.06 * BEVEL_MM)


def skin_over_fat(face):
    """Fat under a skin 4 mm thick that holds three times the tip, from any face, in 1 mm voxels."""
    axis, end = divmod(ss.FACES.index(face), 2)
    voxels = np.ones((40, 40, 40), np.uint8)
    skin = [slice(None)] * 3
    skin[axis] = slice(-4, None) if end else slice(4)
    voxels[tuple(skin)] = 2
    soft = Material(10, friction_n_per_mm=0.02, cutting_force_n=0.5)
    hard = Material(60, friction_n_per_mm=0.05, cutting_force_n=1.5)
    return TissueMap(ss.LabelMap(voxels=voxels, spacing=1.0), {1: soft, 2: hard})


@pytest.mark.parametrize("face", ["x-", *(pytest.param(face, marks=pytest.mark.slow) for face in ss.FACES[1:])])
@given(place=places, aside=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)))
@settings(max_examples=8)
def test_force_is_continuous_from_the_skin_through_every_layer(face, place, aside):
    tissues = skin_over_fat(face)
    tissue = ss.Tissue(tissues.labels.grid(13**3), face)
    load = TissueForce(tissues, width=3.0)
    depths = np.linspace(0, 0.5, 60)[1:]
    force = np.array([load.total_force(pushed(tissue, place, aside, depth)) for depth in depths])
    step = (depths[1] - depths[0]) * tissue.grid.side
    steepest = 1.5 * (1500 / load.build_up + 1000 / BEVEL_MM) + 50  # build-up, change of tissue, friction
    assert 0 < force[0] <= steepest * step
    assert np.abs(np.diff(force)).max() <= steepest * step
    assert force[-1] == pytest.approx(load.total_force(pushed(tissue, place, aside, 0.5)))

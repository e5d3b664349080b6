"""The load acts on the tissue that the needle is in, once that has moved."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from sonospline.geometry.volume import Volume
from sonospline.mechanics import LineForce, Material, Shaft, TissueForce, TissueMap, labelled_cube
from sonospline.models.elastic import ElasticModel

SIDE = 60.0
BOX = ss.Tissue(ss.Grid(shape=(17,) * 3, spacing=SIDE / 16))
NEEDLE = ss.Needle((0, 25, 31), (36, 33, 29))


def model_of(name="body", stiffness_kpa=10.0, box=BOX, **options):
    tissues = labelled_cube(name, side=SIDE, stiffness_kpa=stiffness_kpa, voxels=24)
    return ElasticModel(box, tissues, nodes=17**3, **options)


def pushed(model, needle=NEEDLE, steps=60):
    state = model.rest
    for k in range(1, steps + 1):
        response = model.step(state, {"needle": ss.Needle(needle.entry, needle.at(k / steps))})
        state = response.state
    return response


def away(found, expected):
    """Mean distance of two responses' displacements over the second's mean."""
    a, b = (response.state.solution.displacement for response in (found, expected))
    return np.linalg.norm(a - b, axis=0).mean() / np.linalg.norm(b, axis=0).mean()


SLOW = pytest.mark.slow


@pytest.mark.parametrize("name", [pytest.param("homogeneous", marks=SLOW), "layers", pytest.param("body", marks=SLOW)])
def test_the_tissue_that_is_loaded_at_the_tip_is_that_which_the_tip_is_in(name):
    model = model_of(name)
    at_rest = model.settle(pushed(model, steps=12), tolerance=1e-4)
    ((_, shaft),) = at_rest.state.shafts
    moved = np.linalg.norm(at_rest.field.displacement(shaft.places[-1]))
    assert moved > 1.0  # else nothing is shown
    assert np.linalg.norm(at_rest.field.forward(shaft.places[-1]) - NEEDLE.tip) < 0.01 * moved
    along = NEEDLE.at(shaft.along / NEEDLE.depth)
    inside = shaft.places[:, 0] > 0.5
    assert np.linalg.norm(at_rest.field.forward(shaft.places)[inside] - along[inside], axis=1).max() < 0.02 * moved


@pytest.mark.parametrize("name", ["homogeneous", pytest.param("body", marks=SLOW)])
@pytest.mark.parametrize("stiffness_kpa", [10.0, pytest.param(6.0, marks=SLOW)])
def test_a_pass_keeps_the_load_on_the_needle_to_half_a_hundredth(name, stiffness_kpa):
    """Its lag alone: the iteration's own error is taken out."""
    model = model_of(name, stiffness_kpa)
    last = pushed(model)
    there = model.settle(last, tolerance=1e-4)
    own = model.solver.settle(last.state.solution, tolerance=1e-4).displacement
    expected = there.state.solution.displacement
    assert np.linalg.norm(own - expected, axis=0).mean() < 0.005 * np.linalg.norm(expected, axis=0).mean()
    undeformed = model_of(name, stiffness_kpa, load_at="undeformed")
    assert away(undeformed.settle(pushed(undeformed), tolerance=1e-4), there) > 0.05  # what it would be without


def test_the_load_of_a_steady_needle_goes_on_with_its_tissue():
    """Found in the field before each step alone, it lags by 0.004."""
    model = model_of("homogeneous")
    last = pushed(model)
    own, there = model.solver.settle(last.state.solution, tolerance=1e-5), model.settle(last, tolerance=1e-5)
    expected = there.state.solution.displacement
    assert np.linalg.norm(own.displacement - expected, axis=0).mean() < 5e-4 * np.linalg.norm(expected, axis=0).mean()
    ((_, shaft),) = last.state.shafts
    assert 0.01 < np.linalg.norm(shaft.drift, axis=1).max() < 0.5  # mm of tissue a mm of needle
    back = model.step(last.state, {"needle": ss.Needle(NEEDLE.entry, NEEDLE.at(0.95))})
    assert dict(back.state.shafts)["needle"].drift is None


def test_a_shaft_goes_on_no_further_than_its_needle_nor_out_of_the_tissue():
    grid, was, needle = BOX.grid, ss.Needle((0, 30, 30), (30, 30, 30)), ss.Needle((0, 30, 30), (32, 30, 30))
    last = Shaft(
        np.array([0.0, 30.0]), np.array([[0.0, 30, 30], [28.0, 30, 30]]), drift=np.array([[0.0] * 3, [-0.1, 0, 0]])
    )
    found = Shaft(np.array([0.0, 32.0]), np.array([[0.0, 30, 30], [30.0, 30, 30]]))
    on = found.ahead(needle, last, was, grid)
    np.testing.assert_allclose(on.places, [[-0.0, 30, 30], [29.8, 30, 30]], atol=0.02)
    assert on.found is found.places
    assert found.ahead(was, last, needle, grid) is found  # on the way out
    far = found.ahead(needle, replace(last, drift=np.array([[-9.0, 0, 0], [-50.0, 0, 0]])), was, grid)
    np.testing.assert_allclose(far.places, [[0, 30, 30], [28, 30, 30]], atol=0.1)


def test_one_jump_to_the_target_and_a_withdrawal_find_the_needle_too():
    model = model_of("homogeneous")
    there = model.settle(pushed(model), tolerance=1e-4)
    assert away(model.step(model.rest, {"needle": NEEDLE}), there) < 0.03
    half = {"needle": ss.Needle(NEEDLE.entry, NEEDLE.at(0.5))}
    first = model.step(there.state, half)
    third = model.step(model.step(first.state, half).state, half)
    back = model.settle(third, tolerance=1e-4)
    assert away(first, back) < 0.04 and away(third, back) < 0.003


def test_tissue_at_rest_stays_at_rest_bit_for_bit():
    model = model_of()
    response = pushed(model, steps=6)
    for _ in range(40):
        if response.settled:
            break
        response = model.step(response.state, {"needle": NEEDLE})
    assert response.settled
    copy = pickle.loads(pickle.dumps(response.state))
    again = model.step(copy, {"needle": NEEDLE})
    assert again.settled and again.state == response.state == copy
    assert away(response, model.settle(response, tolerance=1e-4)) < 0.003


def test_the_way_there_is_forgotten_and_the_same_way_gives_the_same_bits():
    model = model_of("layers")
    few, many = (model.settle(pushed(model, steps=steps), tolerance=1e-4) for steps in (3, 30))
    assert away(few, many) < 0.003
    assert pushed(model, steps=5).state == pushed(model, steps=5).state


def test_forces_depend_on_the_pose_alone():
    """Though the tip has pushed the second layer ahead of it: asked where tissue was, the force would have no end."""
    voxels = np.zeros((240, 4, 4), np.uint8)
    voxels[4 * 27 :] = 1
    volume = Volume(voxels=voxels, spacing=(0.25, 15, 15), origin=(0.125, 7.5, 7.5))
    layers = {n: Material(7.0, friction_n_per_mm=0.0, cutting_force_n=force) for n, force in enumerate((1.5, 0.2))}
    tissues, needle = TissueMap(volume, layers), ss.Needle((0, 30, 30), (33.5, 30, 30))
    assert TissueForce(tissues).total_force(needle) == pytest.approx(200)
    force = pushed(ElasticModel(BOX, tissues, nodes=17**3), needle, steps=30).forces["needle"]
    assert force.axial_n + force.lost_n == pytest.approx(0.2, rel=1e-3)


def test_a_load_of_its_own_kind_stays_where_it_is_stated():
    load = LineForce(30.0, 700.0, 3.6)
    model = ElasticModel(BOX, Material(10.0), load, nodes=17**3, load_at="undeformed")
    response = model.settle(model.step(model.rest, {"needle": NEEDLE}), tolerance=1e-4)
    expected = model.solver.solve(load, NEEDLE, tolerance=1e-4).displacement
    assert response.state.shafts == ()
    found = response.state.solution.displacement
    assert np.linalg.norm(found - expected, axis=0).mean() < 5e-4 * np.linalg.norm(expected, axis=0).mean()


def test_where_a_load_acts_is_asked_for_in_words():
    with pytest.raises(ValueError, match="load_at = 'tip' is not known; choose one of deformed, undeformed"):
        ElasticModel(BOX, Material(10.0), load_at="tip")


def test_several_needles_each_find_their_tissue():
    model = model_of("homogeneous")
    needles = {"one": NEEDLE, "two": ss.Needle((0, 42, 20), (25, 42, 20))}
    both = model.settle(model.step(model.rest, needles), tolerance=1e-4)
    for (_, shaft), needle in zip(both.state.shafts, needles.values(), strict=True):
        assert np.linalg.norm(both.field.forward(shaft.places[-1]) - needle.tip) < 0.03


@pytest.mark.parametrize("depth", [34.0, 37.0])
def test_a_needle_at_the_border_of_two_tissues_comes_to_rest(depth):
    """The stiffer one it pushes ahead of its tip, to where it is in the softer one."""
    voxels = np.zeros((60, 60, 60), np.uint8)
    voxels[30:] = 1
    soft, hard = (Material(5.0, friction_n_per_mm=0.0, cutting_force_n=force) for force in (0.1, 1.5))
    tissues = TissueMap(Volume(voxels=voxels, spacing=(1.0,) * 3, origin=(0.5,) * 3), {0: soft, 1: hard})
    model = ElasticModel(BOX, tissues, nodes=17**3)
    needle = ss.Needle((0, 30, 30), (depth, 30, 30))
    response, published = pushed(model, needle, steps=12), []
    while not response.settled and len(published) < 40:
        response = model.step(response.state, {"needle": needle})
        published.append(response.error_estimate)
    assert response.settled and max(published) < 0.05  # to and fro without end it was 0.1 to 0.4
    assert model.step(response.state, {"needle": needle}).state == response.state


def two_layers(first_kpa, second_kpa, cutting_force_n):
    """Of 30 mm each, alike in what they do to a needle: no bone, no friction."""
    voxels = np.zeros((60, 60, 60), np.uint8)
    voxels[30:] = 1
    stiffnesses = enumerate((first_kpa, second_kpa))
    layers = {n: Material(e, friction_n_per_mm=0.0, cutting_force_n=cutting_force_n) for n, e in stiffnesses}
    box = ss.Tissue(ss.Grid(shape=(13,) * 3, spacing=SIDE / 12))
    return ElasticModel(
        box, TissueMap(Volume(voxels=voxels, spacing=(1.0,) * 3, origin=(0.5,) * 3), layers), nodes=13**3
    )


def at_depth(depth):
    return {"needle": ss.Needle((0, 30, 30), (depth, 30, 30))}


def test_a_load_that_soft_tissue_takes_back_into_stiff_tissue_finds_its_rest():
    """The whole way each time it went to and fro between them, 0.2 of the field beside its needle, without end."""
    model = two_layers(60.0, 1.0, 1.25)
    assert model.settle(model.step(model.rest, at_depth(50.0))).error_estimate <= 0.01


@pytest.mark.parametrize("step_mm", [1.0, 1.5])
def test_a_load_goes_no_further_than_the_iterations_left_resolve(step_mm):
    """Where a tip comes from soft tissue into stiff tissue; else 0.15 to 0.18 of a field were unfinished."""
    model = two_layers(1.0, 20.0, 1.2)
    state, unfinished = model.rest, []
    for depth in np.arange(3.0, 50.0, step_mm):
        state = model.step(state, at_depth(depth)).state
        own = model.solver.settle(state.solution, tolerance=1e-3).displacement
        off = np.linalg.norm(state.solution.displacement - own, axis=0).mean()
        unfinished.append(off / np.linalg.norm(own, axis=0).mean())
    assert max(unfinished) <= 0.03


def test_a_step_does_not_go_on_from_a_field_that_is_further_away_than_none():
    """Of a needle withdrawn from soft tissue, which it has moved by 13 mm, into stiff tissue, by 0.05."""
    model = two_layers(1000.0, 1.0, 1.2)
    deep = model.settle(model.step(model.rest, at_depth(45.0)))
    found = model.step(deep.state, at_depth(15.0)).state.solution
    assert np.abs(found.displacement).max() < 0.01 * np.abs(deep.state.solution.displacement).max()
    afresh = model.solver.advance(model.solver.rest, found.load)
    assert np.array_equal(found.displacement, afresh.displacement)


def test_a_load_still_goes_on_once_nothing_is_left_to_contract():
    """With iterations to spare a field is at the end of float32 first; its load stayed where it was for good."""
    box = ss.Tissue(ss.Grid(shape=(13,) * 3, spacing=SIDE / 12))
    model = ElasticModel(box, Material(3.0), nodes=13**3, tolerance=1e-4, budget=2000)
    response = model.step(model.rest, at_depth(40.0))
    assert response.state.beside <= 1e-3
    assert model.settle(response, tolerance=1e-3).error_estimate <= 2e-3

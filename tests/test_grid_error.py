"""The error that the cells leave is published beside that of the iteration."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.geometry import Volume
from sonospline.mechanics import Material, TissueMap, labelled_cube
from sonospline.models.elastic import ElasticModel

BOX = ss.Tissue(ss.Grid(shape=(25,) * 3, spacing=100 / 24))
NEEDLE = {"needle": ss.Needle((0, 37.1, 58.6), (57.3, 45.1, 52.6))}
SLOW = pytest.mark.slow


def at_rest(name, nodes):
    tissues = labelled_cube(name, side=100, stiffness_kpa=10, voxels=48)
    model = ElasticModel(BOX, tissues, nodes=nodes, load_at="undeformed")
    return model, model.settle(model.step(model.rest, NEEDLE), tolerance=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["homogeneous", pytest.param("body", marks=SLOW)])
@pytest.mark.parametrize("side", [13, pytest.param(17, marks=SLOW), pytest.param(25, marks=SLOW)])
def test_it_is_half_to_three_times_what_a_fine_grid_finds(name, side):
    model, coarse = at_rest(name, side**3)
    _, fine = at_rest(name, 41**3)
    expected, found = fine.field.on_grid(), coarse.field.on_grid()
    true = np.linalg.norm(found - expected, axis=-1).mean() / np.linalg.norm(expected, axis=-1).mean()
    assert 0.5 * true < model.grid_error(coarse).mean < 3 * true


def test_cells_that_are_too_coarse_for_the_needle_are_said():
    """The iteration's error alone would be a few thousandths."""
    model, coarse = at_rest("homogeneous", 9**3)
    facts = model.facts(coarse)
    assert facts["load_width_mm"] > 2 * facts["load_width_asked_mm"] and facts["error_estimate"] < 2e-3
    assert facts["grid_error"] > 0.05 and facts["grid_error_at_tip"] > 0.01


def test_where_larger_cells_lose_a_fragment_it_is_unknown():
    labels = np.zeros((24,) * 3, np.uint8)
    labels[12:16, 12:16, 12:16] = 1
    materials = {0: Material(stiffness_kpa=10), 1: Material(rigid=True, floating=True)}
    tissues = TissueMap(Volume(voxels=labels, spacing=(100 / 24,) * 3, origin=(50 / 24,) * 3), materials)
    model = ElasticModel(BOX, tissues, nodes=13**3)
    facts = model.facts(model.step(model.rest, NEEDLE))
    assert (facts["grid_error"], facts["grid_error_at_tip"]) == (None, None)
    assert 0 < facts["error_estimate"] < 0.05


def test_tissue_at_rest_has_none():
    model = ElasticModel(BOX, labelled_cube("homogeneous", side=100, voxels=24), nodes=9**3)
    assert model.grid_error(model.step(model.rest)) == (0.0, 0.0)

"""What the comparison of the three models rests on: the held shaft, tissue by tissue, and steps that add up."""

import numpy as np
import pytest

import sonospline as ss
from elastic_problems import largest_difference
from sonospline.elasticity import ElasticSolver
from sonospline.fem import FiniteElementModel
from sonospline.fem.held_shaft import held_shaft
from sonospline.mechanics import LABELLED_CUBES, LineForce, ShaftDisplacement, labelled_cube
from sonospline.mechanics.labelled_cubes import TISSUES
from sonospline.models.elastic import ElasticInsertion
from sonospline.study import model_fields
from sonospline.study import models_compared as models
from sonospline.study.insertions import held_out_insertions

NEEDLE = ss.Needle((0, 0.3, 0.5), (0.6, 0.5, 0.5))
HELD = ShaftDisplacement(radius=0.06)


def cube(nodes):
    return ss.Tissue(ss.Grid.unit_cube(nodes))


@pytest.mark.parametrize("name", ["homogeneous", "layers", "body"])
def test_a_held_shaft_is_that_of_scikit_fem(name):
    pytest.importorskip("skfem")
    solver = ElasticSolver(cube(9), labelled_cube(name, voxels=48), nodes=9**3)
    model = FiniteElementModel(cube(9), solver.moduli, integration="mean_dilatation", solver="direct")
    assert largest_difference(held_shaft(solver, HELD, NEEDLE), model.solve(HELD, NEEDLE)) < 1e-4


def test_a_shaft_between_the_nodes_is_refused():
    solver = ElasticSolver(cube(9), nodes=9**3)
    with pytest.raises(ValueError, match="holds no node of the solver's grid; give a larger radius"):
        held_shaft(solver, ShaftDisplacement(radius=1e-3), ss.Needle((0, 0.44, 0.44), (0.6, 0.44, 0.44)))


def test_a_live_insertion_reaches_each_pose_in_its_share_of_the_steps():
    insertion = ElasticInsertion(cube(9), labelled_cube("layers", voxels=24), LineForce(), nodes=9**3)
    needles = [ss.Needle(NEEDLE.entry, NEEDLE.at(depth)) for depth in (0.5, 1.0)]
    fields = model_fields.live(insertion, needles, steps=7)
    assert insertion.solution.steps >= 7  # and more while the load follows the tissue
    for field, needle in zip(fields, needles, strict=True):
        solver = insertion.solver
        expected = solver.field(solver.solve(insertion.load, needle)).on_grid()
        assert largest_difference(field, expected) < 0.15


def test_every_cube_names_its_tissues():
    for name in LABELLED_CUBES:
        assert len(TISSUES[name]) == len(labelled_cube(name).materials)


def test_errors_by_tissue_are_of_that_tissue_alone():
    labels = np.zeros((4, 4, 4), int)
    labels[2:] = 1
    labels[3, 2:] = 2
    reference = np.where(labels[..., None] == 2, 1e-3, 1.0) * np.ones(3)
    field = np.where(labels[..., None] == 1, 1.5, 1.0)
    assert models._by_tissue({0: "fat", 1: "tumour", 2: "bone"}, labels, field, reference) == {
        "fat": 0.0,
        "tumour": pytest.approx(0.5),
    }


def test_the_kernels_own_factor_on_a_held_shaft_is_a_least_squares_one(monkeypatch):
    scope = models.Scope(("H2",), fine=17, side=9, depths=1, steps=4, cubes=("homogeneous",))
    monkeypatch.setattr(models, "ShaftDisplacement", lambda: HELD)
    tuned = ss.NeedleTissueModel.tuned()
    factors = models.held_factors(scope, tuned)
    plan = held_out_insertions()[1]
    rows = models.compare_held(scope, "homogeneous", plan, tuned, factors)
    errors = {row["model"]: row["rmse"] for row in rows}
    for name in factors:
        for wrong in (0.5, 1.5):
            worse = models.compare_held(scope, "homogeneous", plan, tuned, {**factors, name: wrong * factors[name]})
            assert errors[name] < {row["model"]: row["rmse"] for row in worse}[name]

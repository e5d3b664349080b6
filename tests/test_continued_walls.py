"""Walls of a box beyond which tissue goes on, against boxes that are larger and solutions by others."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from gauss_reference import field_under
from sonospline import cli
from sonospline.elasticity import ElasticSolver, RelaxingSolver
from sonospline.mechanics import LineForce, Material, TissueMap, labelled_cube
from sonospline.mechanics.continued_walls import ContinuedWalls
from sonospline.models.elastic import ElasticModel

NEEDLE = ss.Needle((0, 0, 0), (36, 4, 0))
LOAD = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5)


def block(side, spacing=6.0, face="x-"):
    """A box of so many millimetres around the same needle, entered at the same place."""
    nodes = round(side / spacing) + 1
    return ss.Tissue(ss.Grid(shape=(nodes,) * 3, spacing=spacing, origin=(0, -side / 2, -side / 2)), face)


def at_tip(solver):
    return float(np.linalg.norm(solver.field(solver.solve(LOAD, NEEDLE)).displacement(NEEDLE.tip)))


def made(side=72, material=None, walls="continued"):
    tissue = block(side)
    return ElasticSolver(tissue, material or Material(10), nodes=tissue.grid, walls=walls)


def body():
    cube = labelled_cube("body", side=72, voxels=36)
    labels = ss.LabelMap(voxels=cube.labels.voxels, spacing=cube.labels.spacing, origin=(1, -35, -35))
    rigid = {label: replace(m, rigid=m.stiffness_kpa > 1000) for label, m in cube.materials.items()}
    return TissueMap(labels, rigid)


def test_a_crop_moves_as_a_body_does_and_not_as_one_in_a_vice():
    whole = (at_tip(made(216)) + at_tip(made(216, walls="pinned"))) / 2
    continued, pinned = (abs(at_tip(made(72, walls=walls)) / whole - 1) for walls in ("continued", "pinned"))
    assert continued < 0.11
    assert pinned > 0.24


def test_walls_hold_in_proportion_to_stiffness_and_by_their_distance():
    tissue = block(60, 6.0)
    walls = ContinuedWalls.of(tissue)
    shear = np.full([n - 1 for n in tissue.grid.shape], 2.5)
    springs = walls.at_nodes(shear)
    assert not springs[:, 0, 1:-1, 1:-1].any()  # the free face
    assert not springs[:, 1:-1, 1:-1, 1:-1].any()
    ahead = springs[:, -1, 5, 5] / (2.5 * 36 / 30)  # area, distance from the middle
    np.testing.assert_allclose(ahead, [4, 2, 2])
    np.testing.assert_allclose(walls.at_nodes(2 * shear), 2 * springs)
    uneven = np.where(np.arange(10) < 5, 1.0, 3.0)[:, None, None] * np.ones((10, 10, 10))
    np.testing.assert_allclose(walls.at_nodes(uneven)[1, 5, 0, 4], 2 * walls.springs[1, 5, 0, 4])


@pytest.mark.parametrize("name", ["uniform", "body"])
def test_the_field_is_that_of_a_solution_by_others_and_of_the_twin(backend, name):
    pytest.importorskip("skfem")
    pytest.importorskip("pyamg")
    solver = made(72, body() if name == "body" else None)
    state = solver.solve(LOAD, NEEDLE, tolerance=1e-5)
    load = np.moveaxis(state.load, 0, -1)
    expected = field_under(solver.tissue, solver.moduli, load)
    found = np.moveaxis(state.displacement, 0, -1)
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.linalg.norm(found[-1], axis=-1).max() > 0.01 * np.linalg.norm(found, axis=-1).max()


def test_walls_and_bone_carry_the_whole_load():
    solver = made(72, body())
    state = solver.solve(LOAD, NEEDLE, tolerance=1e-5)
    whole = state.load.sum(axis=(1, 2, 3), dtype=float)
    np.testing.assert_allclose(solver.reaction(state), -whole, atol=1e-3 * np.abs(whole).max())


def test_a_pass_follows_within_its_tolerance_and_says_so():
    tissue = block(72)
    model = ElasticModel(tissue, body(), nodes=tissue.grid, walls="continued", load_at="undeformed")
    response = model.step(model.rest)
    for part in np.linspace(0.1, 1, 10):
        response = model.step(response.state, {"needle": ss.Needle(NEEDLE.entry, NEEDLE.at(part))})
    found = response.state.solution
    exact = model.solver.settle(found, tolerance=1e-5)
    off = np.linalg.norm(found.displacement - exact.displacement, axis=0).mean()
    off /= np.linalg.norm(exact.displacement, axis=0).mean()
    assert off < 0.0125
    assert off / 2 < found.error < 0.0125
    assert model.grid_error(response).mean < 0.1
    assert model.identity != ElasticModel(tissue, body(), nodes=tissue.grid, load_at="undeformed").identity


@pytest.mark.parametrize("exponents", [(0.2, 0.2), (0.2, 0.21)], ids=["alike", "tissue by tissue"])
def test_what_holds_walls_relaxes_as_tissue_does(exponents):
    halves = np.zeros((36, 36, 36), int)
    halves[18:] = 1
    labels = ss.LabelMap(voxels=halves, spacing=(2, 2, 2), origin=(1, -35, -35))
    soft = {label: Material(10, relaxation_exponent=exponent) for label, exponent in enumerate(exponents)}
    solver = made(72, TissueMap(labels, soft))
    relaxing = RelaxingSolver(solver)
    forces = solver.nodal_load(LOAD, NEEDLE)
    pushed = relaxing.advance(relaxing.rest, forces, dt=0.0)
    held = relaxing.advance(pushed, forces, dt=100.0)
    crept = [np.linalg.norm(state.solution.displacement, axis=0) for state in (pushed, held)]
    ratio = crept[1] / np.maximum(crept[0], 1e-9)
    assert ratio[5, 6, 6] > 4
    np.testing.assert_allclose(ratio[-1, 4:9, 4:9], ratio[5, 6, 6], rtol=0.05)


def test_a_copy_in_another_process_is_the_same():
    solver = made(48)
    again = pickle.loads(pickle.dumps(solver))
    assert at_tip(again) == at_tip(solver)


@pytest.mark.slow
def test_insert_says_by_how_much_walls_give_way(tmp_path, capsys):
    pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    small = ["--model", "elastic", "--walls", "continued", "--nodes", "3000", "--steps", "2", "--quiet"]
    assert cli.main(["insert", *small, "--out", str(tmp_path / "out")]) == 0
    assert "walls give way by" in capsys.readouterr().out


def test_other_walls_are_refused():
    with pytest.raises(ValueError, match=r"walls = 'rubber'.*pinned.*continued"):
        made(48, walls="rubber")

"""Loose fragments of bone: rigid bodies in elastic tissue."""

import pickle

import numpy as np
import pytest

import sonospline as ss
from elastic_problems import largest_difference
from sonospline.elasticity import ElasticSolver
from sonospline.fem import FiniteElementModel
from sonospline.geometry.volume import Volume
from sonospline.mechanics import LineForce, Material, TissueMap

TISSUE = ss.Tissue(ss.Grid.unit_cube(13))
NEEDLE = ss.Needle((0, 0.3, 0.5), (0.6, 0.5, 0.45))
LOOSE = Material(rigid=True, floating=True)


def with_blocks(material, *blocks, voxels=48, others=None):
    """The unit cube with blocks (lowest, highest corner) of a material; ``others`` are of bone that stays."""
    labels = np.zeros((voxels,) * 3, np.uint8)
    for label, places in ((1, blocks), (2, others or ())):
        for low, high in places:
            labels[tuple(slice(round(a * voxels), round(b * voxels)) for a, b in zip(low, high, strict=True))] = label
    volume = Volume(voxels=labels, spacing=(1 / voxels,) * 3, origin=(0.5 / voxels,) * 3)
    return TissueMap(volume, {0: Material(), 1: material, 2: Material(rigid=True)})


CELL = ((1 / 3, 1 / 3, 1 / 3), (5 / 12, 5 / 12, 5 / 12))
SPECK = ((1 / 3, 1 / 3, 1 / 3), (3 / 8, 3 / 8, 3 / 8))
BESIDE = ((0.45, 0.3, 0.2), (0.7, 0.7, 0.4))
BEYOND = ((0.7, 0.6, 0.6), (0.85, 0.85, 0.85))


def solver_of(tissues):
    return ElasticSolver(TISSUE, tissues, nodes=13**3)


@pytest.mark.parametrize(
    "blocks", [pytest.param((BESIDE,), marks=pytest.mark.slow), (BESIDE, BEYOND)], ids=["one", "two"]
)
def test_a_fragment_moves_as_a_very_stiff_one_does_in_scikit_fem(blocks):
    pytest.importorskip("skfem")
    loose, stiff = solver_of(with_blocks(LOOSE, *blocks)), with_blocks(Material(stiffness_kpa=1e5), *blocks)
    found = loose.solve(LineForce(), NEEDLE, tolerance=1e-5)
    model = FiniteElementModel(TISSUE, stiff.moduli(TISSUE.grid), integration="mean_dilatation", solver="direct")
    forces = loose.nodal_load(LineForce(), NEEDLE)
    reference = np.moveaxis(_solved(model, forces), -1, 0)
    assert largest_difference(found.displacement, reference) < 2e-4
    np.testing.assert_allclose(loose.reaction(found), -forces.sum(axis=(1, 2, 3)), atol=1e-6)


def _solved(model, forces):
    """What the reference's matrices answer to forces on the nodes."""
    from scipy.sparse.linalg import spsolve

    from sonospline.fem.scikit_assembly import assemble

    matrices = assemble(model._system())
    free = np.flatnonzero(~model._pinned)
    out = np.zeros((len(model._pinned), 3))
    out[free] = spsolve(matrices.free.tocsc(), forces.reshape(3, -1).T[free].ravel()).reshape(-1, 3)
    return out.reshape(*TISSUE.grid.shape, 3)


def test_a_fragment_keeps_its_shape_and_the_live_field_keeps_up():
    solver = solver_of(with_blocks(LOOSE, BESIDE))
    state, nodes = solver.rest, solver.moduli.rigid_nodes
    for k in range(1, 31):
        state = solver.step(state, LineForce(), ss.Needle(NEEDLE.entry, NEEDLE.at(k / 30)))
    exact = solver.solve(LineForce(), NEEDLE, tolerance=1e-5).displacement
    assert np.linalg.norm(state.displacement - exact, axis=0).mean() < 0.01 * np.linalg.norm(exact, axis=0).mean()
    place = np.argwhere(nodes) / 12
    moved = state.displacement[:, nodes].T
    design = np.hstack([np.ones((len(place), 1)), place])
    gradient = np.linalg.lstsq(design, moved, rcond=None)[0]
    assert np.abs(design @ gradient - moved).max() < 1e-5 * np.abs(moved).max()  # affine
    assert np.abs(gradient[1:] + gradient[1:].T).max() < 1e-5 * np.abs(gradient[1:]).max()  # a turn
    assert np.linalg.norm(moved, axis=1).min() > 0.05 * np.linalg.norm(state.displacement, axis=0).max()


def test_a_solver_with_fragments_is_pickled_and_answers_with_the_same_bits():
    solver = solver_of(with_blocks(LOOSE, BESIDE))
    again = pickle.loads(pickle.dumps(solver))
    ours, theirs = (each.step(each.rest, LineForce(), NEEDLE).displacement for each in (solver, again))
    assert (ours == theirs).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Material(floating=True), "floating = True is for what is rigid"),
        (
            lambda: solver_of(with_blocks(LOOSE, CELL)),
            "fills a single cell",
        ),
        (lambda: solver_of(with_blocks(LOOSE, SPECK)), "is half of no cell"),
        (lambda: solver_of(with_blocks(LOOSE, ((0.7, 0.4, 0.4), (1, 0.6, 0.6)))), "touches a pinned face of the box"),
        (
            lambda: solver_of(with_blocks(LOOSE, BESIDE, others=[((0.7, 0.3, 0.2), (0.9, 0.7, 0.4))])),
            "touches bone that does not move",
        ),
        (
            lambda: FiniteElementModel(TISSUE, with_blocks(LOOSE, BESIDE).moduli(TISSUE.grid)),
            "material has floating fragments",
        ),
    ],
)
def test_fragments_that_cannot_float_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()

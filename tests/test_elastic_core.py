"""The core's elastic solver against assembled matrices and its NumPy twin."""

import numpy as np
import pytest

from builds import INSTRUCTION_SETS, needs_core
from sonospline._core import hexahedra
from sonospline._core.twin import elastic as twin_elastic

FIVE_PINNED = [False, True, True, True, True, True]


def levels_over(cells, spacing, seed=0, coarsenings=1):
    """Random, uneven moduli, and grids of half as many cells above them (not means: any will do)."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(coarsenings + 1):
        shear = np.exp(rng.normal(size=cells)).astype(np.float32)
        lame = (9 * np.exp(rng.normal(size=cells))).astype(np.float32)
        found.append((tuple(map(float, spacing)), lame, shear))
        coarse = [-(-n // 2) for n in cells]
        spacing = [h * n / c for h, n, c in zip(spacing, cells, coarse, strict=True)]
        cells = coarse
    return found


def nodal(cells, seed=1):
    return np.random.default_rng(seed).normal(size=(3, *[n + 1 for n in cells])).astype(np.float32)


NO_INVERSE = np.zeros((0, 0), np.float32)
BOXES = [
    ((6, 7, 9), (1.0, 1.0, 1.0)),
    ((6, 7, 9), (1.0, 1.3, 0.8)),
    ((5, 4, 31), (0.5, 0.5, 0.5)),  # rows beyond a vector
    ((4, 20, 4), (2.0, 2.1, 1.0)),  # rows shorter than a vector
]


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize("full", [False, True], ids=["mean dilatation", "full"])
@pytest.mark.parametrize(("cells", "spacing"), BOXES)
def test_the_product_equals_that_of_the_assembled_matrix(native, isa, full, cells, spacing):
    native.use_instruction_set(isa)
    grids = levels_over(cells, spacing)
    values = nodal(cells)
    expected = (hexahedra.stiffness(grids[0], full) @ values.ravel().astype(float)).reshape(values.shape)
    found = native.ElasticMultigrid(grids, FIVE_PINNED, full, 3, NO_INVERSE).product(values)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize("pinned", [FIVE_PINNED, [True, True, True, False, True, True]], ids=["x- free", "y+ free"])
@pytest.mark.parametrize(("cells", "spacing"), BOXES)
def test_iterations_agree_with_the_twin(native, isa, pinned, cells, spacing):
    native.use_instruction_set(isa)
    arguments = levels_over(cells, spacing), pinned, False, 3, NO_INVERSE
    start = 0.1 * nodal(cells, seed=2)
    start[:, ~hexahedra.free_nodes(cells, pinned)] = 0
    ours, errors, sound = native.ElasticMultigrid(*arguments).iterate(nodal(cells), start, 4, True)
    theirs, expected_errors, _ = twin_elastic.ElasticMultigrid(*arguments).iterate(nodal(cells), start, 4, True)
    assert sound and len(errors) == 5
    np.testing.assert_allclose(errors, expected_errors, rtol=2e-3, atol=1e-6)
    assert np.abs(ours - theirs).max() < 2e-5 * np.abs(theirs).max()


@needs_core
def test_a_team_gives_what_one_thread_gives(native):
    cells = (40, 34, 36)  # large enough to be shared
    arguments = levels_over(cells, (1.0, 1.1, 0.9)), FIVE_PINNED, False, 3, NO_INVERSE
    found = []
    for threads in (1, 3):
        native.set_thread_count(threads)
        found.append(native.ElasticMultigrid(*arguments).iterate(nodal(cells), 0 * nodal(cells), 3, True))
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-4)
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-5 * np.abs(found[0][0]).max()


@needs_core
def test_the_same_input_gives_the_same_bits(native):
    cells = (36, 34, 36)
    solver = native.ElasticMultigrid(levels_over(cells, (1.0, 1.0, 1.0)), FIVE_PINNED, False, 3, NO_INVERSE)
    first, second = (solver.iterate(nodal(cells), 0 * nodal(cells), 2, True)[0] for _ in range(2))
    assert (first == second).all()


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
def test_a_line_load_agrees_with_the_twin(native, isa):
    native.use_instruction_set(isa)
    arguments = (
        (13, 12, 18),
        (0.1, 0.09, 0.07),
        np.array([0.05, 0.9, 0.2]),
        np.array([0.8, -0.36, 0.48]),
        np.array([0.0, 0.2, 0.35, 0.6]),
        np.array([1.0, -0.7, 2.0, -2.3]),
        0.6,
        0.4,
        0.09,
    )
    ours, theirs = native.line_load(*arguments), twin_elastic.line_load(*arguments)
    assert np.abs(ours - theirs).max() < 2e-6 * np.abs(theirs).max()


def test_a_cell_resists_no_rigid_motion_and_stretches_as_hooke_says():
    spacing = (1.0, 1.5, 0.7)
    corner = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * spacing
    dilatation, distortion = hexahedra.cell_matrices(spacing, full=False)
    for rotation in np.eye(3):
        turned = np.cross(rotation, corner).T.ravel()
        assert np.abs(dilatation @ turned).max() < 1e-14 and np.abs(distortion @ turned).max() < 1e-14
    stretch = np.concatenate([0.1 * corner[:, 0], np.zeros(16)])
    volume = np.prod(spacing)
    assert stretch @ dilatation @ stretch == pytest.approx(volume * 0.1**2)  # lambda tr^2
    assert stretch @ distortion @ stretch == pytest.approx(volume * 2 * 0.1**2)  # 2 mu eps:eps

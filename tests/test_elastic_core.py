"""The core's elastic solver against assembled matrices and its NumPy twin."""

import numpy as np
import pytest
from scipy import sparse

import sonospline as ss
from builds import INSTRUCTION_SETS, needs_core
from sonospline import _core
from sonospline._core import cubic_axis, hexahedra, twin
from sonospline._core.stencils import coarser, from_sparse, hold, to_sparse
from sonospline._core.twin import elastic as twin_elastic
from sonospline._core.twin import elastic_inverse as twin_inverse
from sonospline._core.twin import elastic_load as twin_load

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


def layers_in(cells, seed=3):
    """A third of the cells, in no order, as stiff again in directions of their own."""
    rng = np.random.default_rng(seed)
    which = rng.permutation(np.argwhere(rng.random(cells) < 1 / 3))
    roots = rng.normal(size=(len(which), 6, 6))
    return which, (roots @ roots.transpose(0, 2, 1)).astype(np.float32)


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
    grids, layers = levels_over(cells, spacing), layers_in(cells)
    values = nodal(cells)
    shape = tuple(n + 1 for n in cells)
    springs = springs_at(np.ones(shape, bool))
    matrix = hexahedra.stiffness(grids[0], full) + hexahedra.layer_stiffness(shape, grids[0][0], *layers)
    matrix = matrix + sparse.diags(springs.ravel().astype(float))
    expected = (matrix @ values.ravel().astype(float)).reshape(values.shape)
    solver = native.ElasticMultigrid(grids, FIVE_PINNED, full, 3, NO_INVERSE, None, (), *layers, springs)
    found = solver.product(values)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize("pinned", [FIVE_PINNED, [True, True, True, False, True, True]], ids=["x- free", "y+ free"])
@pytest.mark.parametrize(("cells", "spacing"), BOXES)
def test_iterations_agree_with_the_twin(native, isa, pinned, cells, spacing):
    native.use_instruction_set(isa)
    arguments = levels_over(cells, spacing), pinned, False, 3, NO_INVERSE, None, (), *layers_in(cells)
    start = 0.1 * nodal(cells, seed=2)
    start[:, ~hexahedra.free_nodes(cells, pinned)] = 0
    ours, errors, sound = native.ElasticMultigrid(*arguments).iterate(nodal(cells), start, 4, True)
    theirs, expected_errors, _ = twin_elastic.ElasticMultigrid(*arguments).iterate(nodal(cells), start, 4, True)
    assert sound and len(errors) == 5
    np.testing.assert_allclose(errors, expected_errors, rtol=2e-3, atol=1e-6)
    assert np.abs(ours - theirs).max() < 2e-5 * np.abs(theirs).max()


def springs_at(free):
    """Of some nodes that move, another along each axis."""
    rng = np.random.default_rng(4)
    return (10 * rng.random((3, *free.shape)) * (free & (rng.random(free.shape) < 0.2))).astype(np.float32)


def beside_bone(cells, spacing, halved=(True, True, True)):
    """A level with random moduli and nodes that do not move, and two grids of Galerkin's below it."""
    (level,) = levels_over(cells, spacing, coarsenings=0)
    fixed = (~hexahedra.free_nodes(cells, FIVE_PINNED)).astype(np.uint8)
    fixed[1:3, 1:3, -4:-1] = 1
    fixed[np.random.default_rng(3).random(fixed.shape) < 0.05] = 1
    first, second = coarser(fixed.shape, halved), coarser(coarser(fixed.shape, halved), halved)

    def stencils(core, springs):
        of_cells = core.galerkin_of_cells(*level[1:], *hexahedra.cell_matrices(spacing, False), fixed, first)
        hold(of_cells, springs)
        return [of_cells, core.galerkin_of_stencil(of_cells, second)]

    return level, fixed, stencils


@pytest.mark.parametrize("halved", [(True, True, True), (False, True, True), (True, False, False)])
@pytest.mark.parametrize(("cells", "spacing"), BOXES)
def test_coarse_operators_are_those_of_galerkin(backend, cells, spacing, halved):
    level, fixed, stencils = beside_bone(cells, spacing, halved)
    springs = springs_at(fixed == 0)
    of_cells, of_stencil = stencils(_core.active, springs)
    move = np.tile(fixed.ravel() == 0, 3)
    matrix = hexahedra.stiffness(level, False) + sparse.diags(springs.ravel().astype(float))
    matrix = (matrix.multiply(move).T.multiply(move)).tocsr()
    for found, fine in ((of_cells, fixed.shape), (of_stencil, of_cells.shape[1:])):
        axes = [twin_elastic.axis_transfer(f - 1, c - 1, True) for f, c in zip(fine, found.shape[1:], strict=True)]
        move = sparse.diags(np.tile(found[0].ravel() > 0, 3).astype(float))
        # A coarse node that is a fixed one has no row, and takes no part in the next grid.
        transfer = sparse.kron(sparse.eye(3), sparse.kron(sparse.kron(axes[0], axes[1]), axes[2])) @ move
        matrix = transfer.T @ matrix @ transfer
        assert abs(to_sparse(found) - matrix).max() <= 2e-6 * abs(matrix).max()
    assert of_cells.any()


def test_a_stencil_and_its_matrix_are_the_same(rng):
    stencil = rng.normal(size=(126, 3, 4, 5)).astype(np.float32)
    stencil = from_sparse(to_sparse(stencil), (3, 4, 5))  # without what lies outside
    matrix = to_sparse(stencil)
    assert abs(matrix - matrix.T).max() > 0.1  # a node's block to itself was any
    np.testing.assert_array_equal(from_sparse(matrix, (3, 4, 5)), stencil)


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize(("cells", "spacing"), BOXES)
def test_iterations_beside_bone_agree_with_the_twin(native, isa, cells, spacing):
    native.use_instruction_set(isa)
    level, fixed, stencils = beside_bone(cells, spacing)
    springs = springs_at(fixed == 0)
    load, start = nodal(cells), 0.1 * nodal(cells, seed=2) * (fixed == 0)
    found = []
    for core in (native, twin):
        coarse = [stencil for stencil in stencils(core, springs) if stencil.any()]
        solver = core.ElasticMultigrid([level], FIVE_PINNED, False, 3, NO_INVERSE, fixed, coarse, springs=springs)
        found.append(solver.iterate(load, start, 4, True))
    (ours, errors, sound), (theirs, expected_errors, _) = found
    assert sound and not ours[:, fixed > 0].any()
    assert np.abs(ours - theirs).max() < 1e-5 * np.abs(theirs).max()
    np.testing.assert_allclose(errors, expected_errors, rtol=1e-3)


@needs_core
def test_a_team_gives_what_one_thread_gives(native):
    cells = (40, 34, 36)  # large enough to be shared
    arguments = levels_over(cells, (1.0, 1.1, 0.9)), FIVE_PINNED, False, 3, NO_INVERSE, None, (), *layers_in(cells)
    found = []
    for threads in (1, 3):
        native.set_thread_count(threads)
        found.append(native.ElasticMultigrid(*arguments).iterate(nodal(cells), 0 * nodal(cells), 3, True))
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-4)
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-5 * np.abs(found[0][0]).max()


@needs_core
def test_the_same_input_gives_the_same_bits(native):
    cells = (36, 34, 36)
    layers = layers_in(cells)
    solver = native.ElasticMultigrid(
        levels_over(cells, (1.0, 1.0, 1.0)), FIVE_PINNED, False, 3, NO_INVERSE, None, (), *layers
    )
    first, second = (solver.iterate(nodal(cells), 0 * nodal(cells), 2, True)[0] for _ in range(2))
    assert (first == second).all()


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize("width", [0.001, 0.09, 3.0], ids=["far below a cell", "a cell", "beyond the box"])
@pytest.mark.parametrize("mirrored", ["x-", "y+", "", "x-x+y-y+z-z+"])
def test_nodal_forces_agree_with_the_twin(native, isa, width, mirrored):
    native.use_instruction_set(isa)
    shape, spacing = (13, 12, 18), (0.1, 0.09, 0.07)
    points = np.random.default_rng(3).random((9, 3)) * (np.array(shape) - 1) * spacing
    points[0] = 0.0  # in a corner
    faces = [face in mirrored for face in ("x-", "x+", "y-", "y+", "z-", "z+")]
    arguments = shape, spacing, points, np.arange(1.0, 10), np.array([0.8, -0.36, 0.48]), width, faces
    ours, theirs = native.nodal_forces(*arguments), twin_load.nodal_forces(*arguments)
    assert np.abs(ours - theirs).max() < 2e-6 * np.abs(theirs).max()


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
def test_nodal_forces_along_any_directions_agree_with_the_twin_and_are_those_along_each_axis(native, isa):
    native.use_instruction_set(isa)
    shape, spacing, faces = (13, 12, 18), (0.1, 0.09, 0.07), [True, False, False, True, False, False]
    rng = np.random.default_rng(3)
    points, forces = rng.random((9, 3)) * (np.array(shape) - 1) * spacing, rng.normal(size=(9, 3))
    arguments = shape, spacing, points, forces, 0.09, faces
    ours, theirs = native.nodal_force_vectors(*arguments), twin_load.nodal_force_vectors(*arguments)
    assert np.abs(ours - theirs).max() < 2e-6 * np.abs(theirs).max()
    for axis in range(3):
        along = native.nodal_forces(shape, spacing, points, forces[:, axis].copy(), np.eye(3)[axis], 0.09, faces)
        assert np.abs(ours[axis] - along[axis]).max() < 2e-6 * np.abs(along).max()


def gaussian_times_hats(at, shape, spacing, width):
    """By fine sums over the box."""
    fine = 40
    shares = []
    for x, n, h in zip(at, shape, spacing, strict=True):
        places = (np.arange((n - 1) * fine) + 0.5) * h / fine
        hats = np.maximum(0, 1 - np.abs(places / h - np.arange(n)[:, None]))
        shares.append(hats @ np.exp(-0.5 * ((places - x) / width) ** 2) * h / fine / (width * np.sqrt(2 * np.pi)))
    return np.einsum("i,j,k->ijk", *shares)


@pytest.mark.parametrize("width", [0.03, 0.09, 0.4])
def test_nodal_forces_are_the_integrals_times_the_hat_functions(backend, width):
    shape, spacing, at = (9, 8, 10), (0.1, 0.09, 0.07), np.array([[0.05, 0.4, 0.31]])
    held = _core.active.nodal_forces(shape, spacing, at, np.array([2.0]), np.array([1.0, 0, 0]), width, [False] * 6)
    assert np.abs(held[0] - 2 * gaussian_times_hats(at[0], shape, spacing, width)).max() < 3e-4 * held.max()
    mirrored = _core.active.nodal_forces(
        shape, spacing, at, np.array([2.0]), np.array([1.0, 0, 0]), width, [True] + [False] * 5
    )
    back = 2 * gaussian_times_hats(at[0] * (-1, 1, 1), shape, spacing, width)
    assert np.abs(mirrored[0] - held[0] - back).max() < 3e-4 * held.max()


def test_layers_resist_the_mean_strain_of_a_cell():
    spacing, rng = (1.0, 1.5, 0.7), np.random.default_rng(0)
    corner = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * spacing
    gradient = rng.normal(size=(3, 3))
    strain = np.append(gradient.diagonal(), [(gradient + gradient.T)[a, b] for a, b in ((1, 2), (0, 2), (0, 1))])
    found = hexahedra.mean_strain(spacing) @ (gradient @ corner.T).ravel()
    np.testing.assert_allclose(found, strain, atol=1e-12)
    _, excess = layers_in((1, 1, 6))
    matrix = hexahedra.layer_stiffness((2, 2, 2), spacing, np.zeros((1, 3), np.int64), excess[:1])
    energy = (gradient @ corner.T).ravel() @ matrix @ (gradient @ corner.T).ravel()
    assert energy == pytest.approx(np.prod(spacing) * strain @ excess[0] @ strain)


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize("shape", [(13, 12, 18), (2, 3, 5)])
@pytest.mark.parametrize("size", [0.02, 0.4], ids=["small", "folding"])
def test_undeformed_points_agree_with_the_twin(native, isa, shape, size):
    native.use_instruction_set(isa)
    rng = np.random.default_rng(5)
    smooth = size * np.sin(np.arange(shape[0]))[:, None, None] * np.ones((3, *shape))
    filters = [cubic_axis.filter_matrix(n) for n in shape]
    points = rng.uniform(-0.2, 1.2, (30, 3)) * (np.array(shape) - 1) * (0.3, 0.29, 0.27)
    arguments = smooth.astype(np.float32), (0.3, 0.29, 0.27), *filters, points, points, 40
    ours, theirs = native.undeformed_points(*arguments), twin_inverse.undeformed_points(*arguments)
    assert np.abs(ours - theirs).max() < (1e-5 if size < 0.1 else 0.05)


def test_undeformed_points_are_the_inverse_of_the_field(backend):
    grid = ss.Grid(shape=(13, 12, 14), spacing=(4.0, 4.2, 3.9))
    x, y, z = grid.points.T
    u = np.stack([3 * np.exp(-((x - 20) ** 2 + (y - 20) ** 2) / 200), 0.02 * y, np.sin(z / 15)], axis=-1)
    values = u.reshape(*grid.shape, 3).astype(np.float32)
    field = ss.GridField(grid, values, order=3)
    inside = grid.world(np.random.default_rng(0).uniform(0.1, 0.9, (40, 3)) * grid.extent)
    filters = [cubic_axis.filter_matrix(n) for n in grid.shape]
    found = _core.active.undeformed_points(
        np.moveaxis(values, -1, 0).copy(), grid.spacing, *filters, inside, inside, 40
    )
    assert np.abs(field.forward(found) - inside).max() < 0.01
    ahead = np.array([[-9.0, 20, 20]])
    outside = _core.active.undeformed_points(
        np.moveaxis(values, -1, 0).copy(), grid.spacing, *filters, ahead, ahead, 40
    )
    assert outside[0, 0] == 0  # ahead of the skin the nearest tissue is the skin


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

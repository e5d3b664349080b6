"""The elastic solver against finite elements by others, and against what must hold exactly."""

from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from builds import needs_core
from labelled_tissue import away_from_reference, bone_of
from sonospline import _core
from sonospline.elasticity import ElasticSolver, NotConvergedError
from sonospline.fem import FiniteElementModel
from sonospline.fem.consistent_load import consistent_load
from sonospline.geometry import solver_grid
from sonospline.geometry.volume import Volume
from sonospline.mechanics import (
    LABELLED_CUBES,
    LineForce,
    Load,
    Material,
    ShaftDisplacement,
    TissueForce,
    TissueMap,
    labelled_cube,
)
from sonospline.mechanics.nodal_load import nodal_load
from sonospline.models.elastic import ElasticInsertion

NEEDLE = ss.Needle((0, 0.3, 0.5), (0.6, 0.5, 0.5))
SMALL = 13**3
SLOW = pytest.mark.slow
SIMPLE = [name for name in LABELLED_CUBES if name not in ("bone", "body")]


def cube(nodes=13, **keywords):
    return ss.Tissue(ss.Grid.unit_cube(nodes), **keywords)


def difference(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


@pytest.mark.parametrize(
    ("ratio", "integration"),
    [(0.30, "full"), (0.45, "full"), (0.30, "mean_dilatation"), (0.45, "mean_dilatation"), (0.49, "mean_dilatation")],
)
def test_the_converged_field_is_that_of_scikit_fem(backend, ratio, integration):
    pytest.importorskip("skfem")
    material = Material(2.0, ratio)
    solver = ElasticSolver(cube(9), material, nodes=9**3, integration=integration)
    model = FiniteElementModel(cube(9), material, integration=integration, solver="direct")
    expected = np.moveaxis(model.solve(LineForce(), NEEDLE), -1, 0)
    forces = consistent_load(LineForce(), NEEDLE, solver.nodes)
    assert difference(solver.equilibrium(forces, tolerance=1e-5).displacement, expected) < 1e-4


@pytest.mark.parametrize("face", ["y-", "z+"])
def test_another_face_is_free_and_the_box_any(face, a_rotation):
    pytest.importorskip("skfem")
    grid = ss.Grid(shape=(13, 9, 15), spacing=(8.0, 7.5, 8.2), origin=(-30, 12, 7), direction=a_rotation)
    tissue = ss.Tissue(grid, entry_face=face)
    inside = grid.world(grid.extent * [[0.4, 0.5, 0.6], [0.5, 0.5, 0.4]])
    needle = ss.Needle(*inside)
    load = LineForce(30.0, 700.0, 8.0)
    solver = ElasticSolver(tissue, Material(10), nodes=13 * 9 * 15)
    solver_tissue = ss.Tissue(solver.grid, entry_face=face)
    expected = FiniteElementModel(solver_tissue, Material(10), integration="mean_dilatation", solver="direct").solve(
        load, needle
    )
    state = solver.equilibrium(consistent_load(load, needle, solver.nodes), tolerance=1e-5)
    assert difference(solver.field(state).values, expected) < 1e-4


@pytest.mark.parametrize("name", LABELLED_CUBES)
@pytest.mark.parametrize("ratio", [0.30, 0.45, 0.49])
def test_every_cube_converges_to_the_field_of_scikit_fem(name, ratio):
    pytest.importorskip("skfem")
    assert away_from_reference(labelled_cube(name, voxels=48, poissons_ratio=ratio), 9, solver="direct") < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELLED_CUBES)
@pytest.mark.parametrize("ratio", [0.30, 0.45, 0.49])
def test_every_cube_converges_to_the_field_of_scikit_fem_on_a_finer_grid(name, ratio):
    pytest.importorskip("skfem")
    assert away_from_reference(labelled_cube(name, poissons_ratio=ratio), 17, solver="direct") < 3e-4


@pytest.mark.parametrize("contrast", [pytest.param(1e4, marks=SLOW), 1e6])
def test_a_high_contrast_converges_to_the_field_of_scikit_fem(contrast):
    pytest.importorskip("skfem")
    assert away_from_reference(bone_of(contrast), 13, solver="direct") < 3e-4


def fixed_bone(name="bone", voxels=48, **keywords):
    """A labelled cube whose stiffest tissue does not move."""
    tissues = labelled_cube(name, voxels=voxels, **keywords)
    hardest = max(tissues.materials, key=lambda label: tissues.materials[label].stiffness_kpa)
    bone = replace(tissues.materials[hardest], rigid=True)
    return TissueMap(tissues.labels, {**tissues.materials, hardest: bone})


@pytest.mark.parametrize("ratio", [pytest.param(0.30, marks=SLOW), pytest.param(0.45, marks=SLOW), 0.49])
def test_rigid_tissue_converges_to_the_field_of_scikit_fem_and_does_not_move(ratio):
    pytest.importorskip("skfem")
    tissues = fixed_bone("body", poissons_ratio=ratio)
    assert away_from_reference(tissues, 13, solver="direct") < 3e-4
    solver = ElasticSolver(cube(), tissues, nodes=SMALL)
    state = solver.step(solver.rest, LineForce(), NEEDLE)
    assert solver.moduli.rigid.any() and not state.displacement[:, solver.moduli.rigid_nodes].any()


def test_pinned_faces_and_bone_carry_the_whole_load():
    solver = ElasticSolver(cube(), fixed_bone(), nodes=SMALL)
    needle = ss.Needle((0, 0.4, 0.2), (0.42, 0.4, 0.27))  # into the bone
    force = solver.grid.direction @ solver.nodal_load(LineForce(), needle).sum(axis=(1, 2, 3))
    reaction = solver.reaction(solver.solve(LineForce(), needle, tolerance=1e-5))
    np.testing.assert_allclose(reaction, -force, atol=1e-3 * np.abs(force).max())


@pytest.mark.parametrize("name", ["bone", "body"])
def test_full_integration_converges_to_the_field_of_scikit_fem(name):
    pytest.importorskip("skfem")
    assert away_from_reference(labelled_cube(name, voxels=48), 9, integration="full", solver="direct") < 3e-4


class Plain(Load):
    """A line load without the way round through its axis: by its force per volume."""

    finest_length = 1.0

    def __init__(self, load):
        self.load = load

    def total_force(self, needle, below=np.inf):
        return self.load.total_force(needle, below)

    def body_force(self, points, needle, below=np.inf):
        return self.load.body_force(points, needle, below)


def test_the_load_is_that_of_its_force_per_volume_wherever_the_needle_points(a_rotation):
    grid = ss.Grid(shape=(57, 55, 59), spacing=1.0, origin=(-30, 12, 7), direction=a_rotation)
    load, needle = LineForce(30.0, 700.0, 3.6), ss.Needle(*grid.world(np.array([[20, 22, 25], [36, 34, 33.0]])))
    found, expected = (nodal_load(each, needle, ss.Tissue(grid)).forces for each in (load, Plain(load)))
    assert difference(found, expected) < 3e-4


@pytest.mark.parametrize("width", [0.5, 3.6, 7.0])
def test_total_and_first_moment_of_a_load_are_exact_however_coarse_the_cells(a_rotation, width):
    grid = ss.Grid(shape=(33, 35, 31), spacing=(4.0, 3.7, 4.2), origin=(-30, 12, 7), direction=a_rotation)
    load, needle = LineForce(30.0, 700.0, width), ss.Needle(*grid.world(np.array([[50.0, 61, 56], [71, 68, 73]])))
    forces = grid.direction @ nodal_load(load, needle, ss.Tissue(grid)).forces.reshape(3, -1).astype(float)
    whole = load.total_force(needle)
    np.testing.assert_allclose(forces.sum(axis=1), whole * needle.direction, atol=1e-6 * whole)
    moment = (needle.direction @ forces) @ (grid.points - needle.entry)
    expected = (load.friction * needle.depth / 2 + load.tip_force) * needle.depth * needle.direction
    np.testing.assert_allclose(moment, expected, atol=1e-5 * np.linalg.norm(expected))


def test_the_pinned_faces_carry_the_whole_load():
    solver = ElasticSolver(cube(), labelled_cube("body", voxels=48), nodes=SMALL)
    state = solver.solve(LineForce(), NEEDLE, tolerance=1e-4)
    total = state.load.reshape(3, -1).sum(axis=1, dtype=float)
    assert np.linalg.norm(solver.reaction(state) + total) < 1e-3 * np.linalg.norm(total)


def test_the_forces_are_the_newtons_asked_for():
    tissue = ss.Tissue(ss.Grid(shape=(41, 41, 41), spacing=2.5))
    needle = ss.Needle((20, 50, 50), (70, 50, 50))
    load = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5)
    forces = nodal_load(load, needle, tissue).forces.reshape(3, -1).sum(axis=1, dtype=float)
    np.testing.assert_allclose(forces, [1000 * (0.03 * 50 + 0.7), 0, 0], rtol=1e-6, atol=1e-3)


def test_tissue_half_as_stiff_moves_twice_as_far():
    states = [
        ElasticSolver(cube(), labelled_cube("body", voxels=48, stiffness_kpa=e), nodes=SMALL).step(
            ElasticSolver(cube(), nodes=SMALL).rest, LineForce(), NEEDLE
        )
        for e in (1.0, 0.5)
    ]
    assert difference(states[1].displacement, 2 * states[0].displacement) < 1e-6


def test_tissues_of_one_friction_load_as_a_uniform_line(rng):
    load = TissueForce(tissues=labelled_cube("layers", side=100), width=5.0)
    uniform = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5.0)
    needle, points = ss.Needle((0, 50, 50), (60, 50, 50)), rng.uniform(0, 100, (300, 3))
    np.testing.assert_allclose(load.body_force(points, needle), uniform.body_force(points, needle), atol=1e-9)


def test_friction_is_that_of_the_tissue_along_the_shaft():
    tissues = labelled_cube("layers", side=90)
    slippery = Material(stiffness_kpa=1, friction_n_per_mm=0.0, cutting_force_n=0.2)
    load = TissueForce(tissues=TissueMap(tissues.labels, {**tissues.materials, 1: slippery}), width=5.0)
    assert load.total_force(ss.Needle((0, 45, 45), (45, 45, 45))) == pytest.approx(1000 * (0.03 * 30 + 0.2), rel=0.03)


def pushed(solver, count, needle=NEEDLE, state=None):
    """States of an insertion in so many steps, and the converged displacement at the last."""
    state = solver.rest if state is None else state
    for k in range(1, count + 1):
        state = solver.step(state, LineForce(), ss.Needle(needle.entry, needle.at(k / count)))
        yield state


def error_of(solver, state, tolerance=1e-5, needle=NEEDLE):
    expected = solver.solve(LineForce(), needle, tolerance=tolerance).displacement
    away = np.linalg.norm(state.displacement - expected, axis=0).mean()
    return away / np.linalg.norm(expected, axis=0).mean()


@pytest.mark.parametrize(("name", "limit"), [("homogeneous", 0.01), ("layers", 0.01), ("bone", 0.03), ("body", 0.04)])
def test_one_iteration_or_two_keep_up_with_the_needle(name, limit):
    solver = ElasticSolver(cube(), labelled_cube(name, voxels=48), nodes=SMALL)
    *_, last = pushed(solver, 40)
    assert last.iterations <= 2
    assert error_of(solver, last) < limit


@pytest.mark.parametrize("name", LABELLED_CUBES)
def test_a_sudden_withdrawal_is_caught_in_one_step(name):
    solver = ElasticSolver(cube(), labelled_cube(name, voxels=48), nodes=SMALL)
    *_, deep = pushed(solver, 40)
    half = ss.Needle(NEEDLE.entry, NEEDLE.at(0.5))
    found = solver.step(deep, LineForce(), half)
    assert found.iterations <= 5
    assert error_of(solver, found, needle=half) < 0.015


def test_an_error_that_is_measured_says_how_the_iteration_before_it_contracted():
    """Else an error that follows from the next one is told by an iteration of long ago: by a third of it, once."""
    solver = ElasticSolver(cube(), Material(2.0), nodes=SMALL)
    state = next(state for state in pushed(solver, 40) if not state.measured and state.iterations == 1)
    found = solver.measured(state)
    assert found.contraction != state.contraction
    assert found.contraction == pytest.approx(found.error / solver.safety / state.before)


def test_a_step_keeps_the_state_it_started_from():
    solver = ElasticSolver(cube(), nodes=SMALL)
    state = solver.step(solver.rest, LineForce(), NEEDLE)
    before = state.displacement.copy()
    solver.step(state, LineForce(), NEEDLE)
    assert (state.displacement == before).all() and not solver.rest.displacement.any()
    with pytest.raises(ValueError, match="read-only"):
        state.displacement[:] = 0


def test_a_needle_without_force_leaves_tissue_at_rest():
    solver = ElasticSolver(cube(), nodes=SMALL)
    pushed = solver.step(solver.rest, LineForce(), NEEDLE)
    assert not solver.step(pushed, LineForce(0.0, 0.0), NEEDLE).displacement.any()


def test_a_step_that_breaks_down_keeps_the_last_field(monkeypatch):
    insertion = ElasticInsertion(cube(), Material(), nodes=SMALL)
    field, state = insertion.advance(NEEDLE), insertion.state

    def broken(*_):
        return np.full_like(state.solution.displacement, np.nan), [np.nan], False

    class Broken:
        iterate = staticmethod(broken)

    monkeypatch.setattr(insertion.solver, "_multigrid", Broken)
    with pytest.raises(NotConvergedError, match="last field is kept"):
        insertion.advance(ss.Needle(NEEDLE.entry, (0.5, 0.5, 0.5)))
    assert insertion.field is field and insertion.state is state


def test_an_unreachable_tolerance_says_so(monkeypatch):
    monkeypatch.setattr("sonospline.elasticity.solver._MOST_ITERATIONS", 4)
    solver = ElasticSolver(cube(), labelled_cube("bone", voxels=48), nodes=SMALL)
    with pytest.raises(NotConvergedError, match=r"error estimate is .* above tolerance"):
        solver.solve(LineForce(), NEEDLE, tolerance=1e-6)
    with pytest.raises(ValueError, match="tolerance = 1e-09 is below what float32 resolves"):
        solver.solve(LineForce(), NEEDLE, tolerance=1e-9)


def test_a_state_that_took_many_iterations_settles_as_any_other():
    solver = ElasticSolver(cube(), Material(), nodes=SMALL)
    state = solver.step(solver.rest, LineForce(), NEEDLE, iterations=2)
    assert state.error > 1e-5
    settled = solver.settle(replace(state, iterations=200), tolerance=1e-5)
    assert settled.error <= 1e-5
    assert settled.iterations > 200


@pytest.mark.parametrize("name", ["bone", "body", *(pytest.param(name, marks=SLOW) for name in SIMPLE)])
def test_the_published_error_is_the_true_one_or_a_few_times_that(name):
    solver = ElasticSolver(cube(), labelled_cube(name, voxels=48), nodes=SMALL)
    ratios = []
    for step, state in enumerate(pushed(solver, 40), 1):
        if step % 3 == 0:
            needle = ss.Needle(NEEDLE.entry, NEEDLE.at(step / 40))
            ratios.append(state.error / error_of(solver, state, needle=needle))
    assert min(ratios) > 0.8 and np.quantile(ratios, 0.95) < 3


def test_a_needle_outside_is_refused_and_named():
    solver = ElasticSolver(cube(), nodes=SMALL)
    with pytest.raises(ValueError, match=r"tip = \[1.2, 0.5, 0.5\] lies outside the tissue"):
        solver.step(solver.rest, LineForce(), ss.Needle((0, 0.5, 0.5), (1.2, 0.5, 0.5)))


def test_forces_that_do_not_fit_the_grid_are_refused():
    solver = ElasticSolver(cube(), nodes=SMALL)
    with pytest.raises(
        ValueError, match=r"forces has shape \(3, 5, 5, 5\); give finite ones of shape \(3, 13, 13, 13\)"
    ):
        solver.equilibrium(np.zeros((3, 5, 5, 5)))
    with pytest.raises(ValueError, match="give finite ones"):
        solver.equilibrium(np.full((3, 13, 13, 13), np.nan))


def test_a_prescribed_displacement_is_refused():
    solver = ElasticSolver(cube(), nodes=SMALL)
    with pytest.raises(ValueError, match="is no force; give a LineForce"):
        solver.step(solver.rest, ShaftDisplacement(), NEEDLE)


def test_cells_halve_well_and_are_nearly_cubic():
    for extent, nodes in (((100, 100, 100), 25**3), ((366, 303, 90), 30_000), ((100, 10, 35), 20_000)):
        grid = solver_grid(ss.Grid.covering(extent, nodes=1000), nodes)
        cells = np.array(grid.shape) - 1
        assert all(n // 2 ** int(np.log2(n & -n)) <= 13 for n in cells)
        assert max(grid.spacing) < 1.45 * min(grid.spacing)
        assert 0.6 < grid.node_count / nodes < 1.7
        np.testing.assert_allclose(grid.extent, extent)


def test_a_grid_that_is_given_is_taken_whatever_its_cells():
    wanted = ElasticSolver(cube(), nodes=SMALL)
    given = ElasticSolver(cube(), nodes=wanted.grid)
    np.testing.assert_array_equal(*(each.solve(LineForce(), NEEDLE).displacement for each in (wanted, given)))
    odd = ElasticSolver(cube(), nodes=ss.Grid(shape=(12, 14, 18), spacing=(1 / 11, 1 / 13, 1 / 17)))
    moved, expected = (each.field(each.solve(LineForce(), NEEDLE)).on_grid() for each in (odd, wanted))
    assert np.linalg.norm(moved - expected, axis=-1).mean() < 0.05 * np.linalg.norm(expected, axis=-1).mean()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ElasticSolver(cube(), nodes=ss.Grid.unit_cube(4)), "has 64 nodes; give at least 125"),
        (
            lambda: ElasticSolver(cube(), nodes=ss.Grid(shape=(9, 9, 9), spacing=0.1)),
            "fills another box than tissue.grid",
        ),
        (lambda: ElasticSolver(cube(), Material(1, 0.495)), r"poissons_ratio = 0.495 is out of range; give 0 to 0.49"),
        (lambda: Material(stiffness_kpa=0), "stiffness_kpa = 0 is out of range"),
        (lambda: Material(stiffness_kpa=-3), "stiffness_kpa = -3 is out of range"),
        (lambda: Material(stiffness_kpa=1, poissons_ratio=-0.1), "poissons_ratio = -0.1 is out of range"),
        (lambda: Material(stiffness_kpa=1, poissons_ratio=0.5), "poissons_ratio = 0.5 is out of range"),
        (
            lambda: ElasticSolver(ss.Tissue(ss.Grid(shape=(23, 3, 12), spacing=(1, 1, 1)))),
            r"longest to shortest 11.0; give a box of at most 10 to 1",
        ),
        (lambda: ElasticSolver(cube(), "liver"), "material = 'liver' is none; give a Material"),
        (lambda: ElasticSolver(cube(), integration="reduced"), "integration = 'reduced' is not known"),
        (lambda: ElasticSolver("cube"), "tissue = 'cube' is not a Tissue"),
    ],
)
def test_bad_input_is_refused_before_any_work(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_too_large_a_contrast_is_refused():
    voxels = np.zeros((8, 8, 8), np.uint8)
    voxels[4:] = 1
    materials = {0: Material(stiffness_kpa=1), 1: Material(stiffness_kpa=1e7)}
    tissues = TissueMap(Volume(voxels=voxels, spacing=(1 / 8,) * 3, origin=(1 / 16,) * 3), materials)
    with pytest.raises(ValueError, match=r"differ by 1e\+07 times; give a contrast of at most 1e\+06"):
        ElasticSolver(cube(), tissues, nodes=SMALL)


@needs_core
def test_the_twin_runs_the_same_insertion(monkeypatch):
    found = []
    for backend in (_core.native, _core.twin):
        monkeypatch.setattr(_core, "active", backend)
        solver = ElasticSolver(cube(9), labelled_cube("layers", voxels=24), nodes=9**3)
        *_, last = pushed(solver, 5)
        found.append(solver.field(last).on_grid())
    assert difference(found[0], found[1]) < 2e-5

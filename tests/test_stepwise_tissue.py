"""The stepwise reference of relaxing tissue: its cells, its loads and its steps against closed forms."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from elastic_problems import largest_difference
from gauss_reference import gauss_load
from labelled_tissue import bone_in_part
from sonospline.elasticity import ElasticSolver
from sonospline.fem import FiniteElementModel, StepwiseTissue
from sonospline.fem.bounded_forces import bounded_forces
from sonospline.fem.consistent_load import consistent_load
from sonospline.fem.gaussian_weights import gaussian_weights
from sonospline.mechanics import LineForce, Material, Moduli, TissueMap, labelled_cube

pytest.importorskip("skfem", reason="needs the extra 'fem'")

BOX = ss.Tissue(ss.Grid(shape=(6, 5, 7), spacing=(0.2, 0.25, 0.15)), entry_face="y+")
TIMES, FRACTIONS = np.array([0.5, 10.0]), np.array([0.3, 0.3])


def modulus(time):
    """What is left of the stiffness after a time."""
    return 1 - FRACTIONS.sum() + FRACTIONS @ np.exp(-time / TIMES)


# Forces within bounds


@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 40), apart=st.sampled_from([0.4, 0.5, 1.0, 3.0]), seed=st.integers(0, 10**6))
def test_bounded_forces_are_complementary_even_where_the_compliance_is_singular(n, apart, seed):
    """Gaussians at 0.4 of their width: a condition number of 1e18."""
    rng, places = np.random.default_rng(seed), apart * np.arange(n)
    compliance = np.exp(-0.25 * (places[:, None] - places) ** 2)
    wanted, low, high = 3 * rng.normal(size=n), -rng.random(n), rng.random(n) * (rng.random(n) > 0.2)
    found = bounded_forces(compliance, wanted, low, high)
    gap = wanted + compliance @ found
    assert ((found >= low) & (found <= high)).all()
    assert np.abs(gap[(found > low) & (found < high)]).max(initial=0.0) < 1e-10
    assert (gap[(found == high) & (high > low)] <= 1e-10).all()
    assert (gap[(found == low) & (high > low)] >= -1e-10).all()


def test_a_compliance_that_yields_work_is_refused():
    with pytest.raises(RuntimeError, match="eigenvalue below zero"):
        bounded_forces(np.array([[1.0, 3.0], [3.0, 1.0]]), np.array([0.1, -0.1]), np.full(2, -9.0), np.full(2, 9.0))


# Loads


@pytest.mark.parametrize("point", [(0.31, 0.52, 0.44), (0.03, 0.97, 0.9)])
def test_weights_are_the_integrals_of_gaussian_times_hat(point):
    width, grid, point = 0.11, BOX.grid, np.array(point)

    def density(places):
        """Of the Gaussian and its mirror image in the entry face."""
        image = point * (1, -1, 1) + (0, 2 * grid.extent[1], 0)
        of_both = [np.exp(-0.5 * ((places - at) ** 2).sum(axis=1) / width**2) for at in (point, image)]
        return np.multiply.outer(sum(of_both) / (2 * np.pi * width**2) ** 1.5, [1.0, 0, 0])

    assert largest_difference(gaussian_weights(BOX, point, width), gauss_load(grid, density, points=7)[..., 0]) < 1e-8


def test_weights_are_those_of_the_live_solver_in_any_box(a_rotation):
    from sonospline import _core

    grid = ss.Grid(shape=(9, 7, 8), spacing=(4, 5, 6), origin=(3, -2, 1), direction=a_rotation)
    tissue = ss.Tissue(grid, entry_face="z-", pinned_faces=("x-", "y-", "y+"))
    point, mirrored = grid.world(np.array([29.0, 17, 2])), [face in ("x+", "z-", "z+") for face in ss.FACES]
    local = grid.local(point[None])
    live = _core.active.nodal_forces(grid.shape, grid.spacing, local, np.ones(1), np.eye(3)[0], 3.6, mirrored)
    assert largest_difference(gaussian_weights(tissue, point, 3.6), live[0]) < 1e-6


# Cells


@pytest.mark.parametrize("name", ["layers", "body"])
def test_a_step_of_no_time_is_the_solution_of_the_assembled_finite_elements(name):
    """Layered cells among them; with branches, too, as no time is left to relax."""
    tissue, needle = ss.Tissue(ss.Grid.unit_cube(8)), ss.Needle((0, 0.4, 0.5), (0.6, 0.5, 0.45))
    moduli = labelled_cube(name, voxels=24).moduli(tissue.grid)
    assert len(moduli.layers.cells) > 0
    load = LineForce(width=0.1)
    expected = FiniteElementModel(tissue, moduli, integration="mean_dilatation", solver="direct").solve(load, needle)
    forces = np.moveaxis(consistent_load(load, needle, tissue), 0, -1)
    body = StepwiseTissue(tissue, moduli, times=TIMES, fractions=FRACTIONS)
    assert largest_difference(body.step(body.rest, forces, 0.0).displacement, expected) < 1e-10


def test_rigid_tissue_does_not_move():
    cube = labelled_cube("layers", voxels=24)
    tissues = TissueMap(cube.labels, {**cube.materials, 2: Material(rigid=True)})
    body, forces = StepwiseTissue(ss.Tissue(ss.Grid.unit_cube(7)), tissues), np.zeros((7, 7, 7, 3))
    forces[2:, 3, 3, 0] = 0.01
    moved = body.step(body.rest, forces, 0.0).displacement
    assert not moved[body.moduli.rigid_nodes].any()
    assert moved[2, 3, 3, 0] > 0


@pytest.mark.parametrize("tissues", [labelled_cube("layers", voxels=24), bone_in_part("layers")], ids=["soft", "bone"])
def test_the_live_solver_finds_the_same_equilibrium(tissues):
    tissue = ss.Tissue(ss.Grid.unit_cube(9))
    solver = ElasticSolver(tissue, tissues, nodes=9**3)
    assert solver.grid.shape == (9, 9, 9)
    forces = 0.02 * gaussian_weights(tissue, np.array([0.4, 0.5, 0.55]), 0.1)[..., None] * (0.8, 0, 0.6)
    body = StepwiseTissue(tissue, solver.moduli)
    found = solver.equilibrium(np.moveaxis(forces, -1, 0), tolerance=1e-5).displacement
    assert largest_difference(np.moveaxis(found, 0, -1), body.step(body.rest, forces, 0.0).displacement) < 1e-4


# Time


def bar(fractions):
    """A bar of unit section and E = 2 along x, four cells of a quarter: it slides on three walls."""
    grid = ss.Grid(shape=(5, 2, 2), spacing=(0.25, 1, 1))
    held = np.zeros((*grid.shape, 3), bool)
    held[0, ..., 0] = held[:, 0, :, 1] = held[..., 0, 2] = True
    moduli = Moduli.uniform(grid, Material(stiffness_kpa=2.0, poissons_ratio=0.0))
    return StepwiseTissue(ss.Tissue(grid), moduli, times=[2.0], fractions=fractions, held=held)


def pulled(force):
    forces = np.zeros((5, 2, 2, 3))
    forces[-1, ..., 0] = force / 4
    return forces


def crept(body, until, steps):
    """Displacement of the bar's end under a unit force held from time 0 on."""
    state = body.step(body.rest, pulled(1.0), 0.0)
    for _ in range(steps):
        state = body.step(state, pulled(1.0), until / steps)
    return state.displacement[-1, 0, 0, 0]


def creep(fraction, time, tau=2.0):
    """Of a standard solid under a held load, over its displacement at once."""
    left = 1 - fraction
    return 1 / left - (1 / left - 1) * np.exp(-left * time / tau)


def test_a_bar_creeps_under_a_held_load_as_the_closed_form_says():
    """Two halves in series, each with its own fraction; second order in the step."""
    fractions = np.array([[0.6, 0.6, 0.2, 0.2]]).reshape(1, 4, 1, 1)
    expected = 0.25 * (creep(0.6, 3.0) + creep(0.2, 3.0))
    body = bar(fractions)
    coarse, fine = (abs(crept(body, 3.0, steps) - expected) for steps in (20, 40))
    assert fine < 1e-4 * expected
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.1)
    assert crept(body, 0.0, 1) == pytest.approx(0.5, rel=1e-12)
    assert crept(bar([0.0]), 3.0, 2) == pytest.approx(0.5, rel=1e-12)
    assert crept(body, 1e6, 3) == pytest.approx(0.25 * (1 / 0.4 + 1 / 0.8), rel=1e-6)


@pytest.mark.parametrize("steps", [1, 7])
def test_a_bar_held_at_its_end_relaxes_as_its_series_says_however_time_is_cut(steps):
    """The force that holds it where it is follows from linearity: exact, as the displacement is straight in time."""
    body = bar([0.4])
    state = body.step(body.rest, pulled(1.0), 0.0)
    for step in range(1, steps + 1):
        dt = 3.0 / steps
        free, unit = body.free_response(state, dt), body.response(pulled(1.0), dt)
        force = (0.5 - free[-1, 0, 0, 0]) / unit[-1, 0, 0, 0]
        state = body.step(state, pulled(force), dt)
        assert state.displacement[-1, 0, 0, 0] == pytest.approx(0.5, rel=1e-12)
        assert force == pytest.approx(0.6 + 0.4 * np.exp(-step * dt / 2.0), rel=1e-10)


def test_a_lifted_load_leaves_tissue_that_recovers():
    body = bar([0.5])
    state = body.step(body.step(body.rest, pulled(1.0), 1.0), pulled(1.0), 5.0)
    lifted = body.step(state, pulled(0.0), 0.0).displacement[-1, 0, 0, 0]
    later = body.step(body.step(state, pulled(0.0), 0.0), pulled(0.0), 1e4).displacement[-1, 0, 0, 0]
    assert lifted == pytest.approx(state.displacement[-1, 0, 0, 0] - 0.5, rel=1e-9)
    assert lifted > 0.1
    assert abs(later) < 1e-3 * lifted


def test_uniform_relaxation_is_the_elastic_field_times_one_creep_function():
    body = StepwiseTissue(BOX, Material(poissons_ratio=0.4), times=[2.0], fractions=[0.5])
    forces = np.zeros((*BOX.grid.shape, 3))
    forces[3, 2, 3] = 0.01, -0.02, 0.005
    state = at_once = body.step(body.rest, forces, 0.0)
    for _ in range(60):
        state = body.step(state, forces, 0.05)
    assert largest_difference(state.displacement, creep(0.5, 3.0) * at_once.displacement) < 1e-4


def test_a_turned_box_moves_like_the_straight_one(a_rotation):
    straight = BOX.grid
    turned = ss.Grid(shape=straight.shape, spacing=straight.spacing, origin=(5, 6, 7), direction=a_rotation)
    fractions = np.random.default_rng(0).random((2, 5, 4, 6)) * 0.4
    forces, found = np.random.default_rng(1).normal(size=(6, 5, 7, 3)), []
    for grid, pull in ((straight, forces), (turned, forces @ a_rotation.T)):
        body = StepwiseTissue(ss.Tissue(grid, entry_face="y+"), times=TIMES, fractions=fractions)
        found.append(body.step(body.step(body.rest, pull, 1.0), pull, 1.0).displacement)
    assert largest_difference(found[1], found[0] @ a_rotation.T) < 1e-10


def test_states_are_values():
    body = StepwiseTissue(BOX, times=TIMES, fractions=FRACTIONS)
    forces = np.full((*BOX.grid.shape, 3), 1e-3)
    one, other = (body.step(body.rest, forces, 0.1) for _ in range(2))
    assert one == other == pickle.loads(pickle.dumps(one))
    assert one != body.rest
    with pytest.raises(ValueError, match="read-only"):
        one.displacement[0] = 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"times": [-1.0], "fractions": [0.1]}, "times = -1.0 is out of range"),
        ({"times": [1.0], "fractions": [0.5, 0.2]}, r"fractions has shape \(2,\); give \(1,\)"),
        ({"times": [1.0, 2.0], "fractions": [0.5, 0.5]}, "fractions are out of range"),
        ({"times": [1.0], "fractions": [-0.1]}, "fractions are out of range"),
        ({"times": [1.0], "fractions": [np.nan]}, "fractions are out of range"),
        ({"material": "liver"}, "material = 'liver' is not of this grid"),
    ],
)
def test_what_makes_no_passive_tissue_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        StepwiseTissue(BOX, **arguments)


def test_time_does_not_go_back():
    body = StepwiseTissue(BOX)
    with pytest.raises(ValueError, match="dt = -1"):
        body.step(body.rest, np.zeros((*BOX.grid.shape, 3)), -1)

"""Relaxing tissue against a stepwise direct solution, and against what must hold exactly."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from sonospline import _core
from sonospline.elasticity import ElasticSolver, NotConvergedError, RelaxingSolver
from sonospline.elasticity.tissue_relaxation import TissueRelaxation
from sonospline.fem import StepwiseTissue
from sonospline.mechanics import LineForce, Material, PronySeries, TissueMap, labelled_cube
from sonospline.models.elastic import ElasticModel

NEEDLE = ss.Needle((0, 0.45, 0.5), (0.6, 0.5, 0.5))
TWO = PronySeries((0.3, 0.3), (0.5, 10))
EXPONENTS = (0.05, 0.25, 0.15, 0.1, 0.2, 0.0, 0.1)
FINE = {"tolerance": 1e-5, "budget": 60}


def solver_of(material=None, nodes=5, **keywords):
    return ElasticSolver(ss.Tissue(ss.Grid.unit_cube(nodes)), material, nodes=nodes**3, **keywords)


def relaxing_cube(name, exponents=EXPONENTS, **keywords):
    """A labelled cube whose tissues have exponents of their own."""
    cube = labelled_cube(name, voxels=48, **keywords)
    return TissueMap(
        cube.labels,
        {
            label: Material(each.stiffness_kpa, each.poissons_ratio, relaxation_exponent=exponent)
            for (label, each), exponent in zip(sorted(cube.materials.items()), exponents, strict=False)
        },
    )


def fractions_of(solver):
    """What of each cell relaxes in each of the four terms, of its materials."""
    materials = solver.material.materials
    rows = {
        label: PronySeries.power_law(each.relaxation_exponent).fractions or (0,) * 4
        for label, each in materials.items()
    }
    return solver.material.mean_of_cells(solver.grid, rows)


def load_of(solver):
    return solver.nodal_load(LineForce(), NEEDLE)


def away(found, expected):
    """Mean distance of a state from a displacement, over its mean."""
    far = np.linalg.norm(found.solution.displacement - expected, axis=0).mean()
    return far / np.linalg.norm(expected, axis=0).mean()


def ramped(forces, seconds):
    return lambda time: forces * np.float32(min(time / seconds, 1))


def through(tissue, forces_at, ends, dt=None, **keywords):
    """States at times in s, in one step each or in steps of dt."""
    state, time = tissue.rest, 0.0
    for end in ends:
        count = 1 if dt is None else max(1, round((end - time) / dt))
        for step in range(1, count + 1):
            at = time + (end - time) * step / count
            state = tissue.advance(state, forces_at(at), (end - time) / count, **keywords)
        time = end
        yield state


def stepwise(tissue, fractions, forces_at, ends, dt=0.02):
    """Displacements at times in s by a direct solution with a history of force in each cell, in short steps."""
    pytest.importorskip("skfem")
    solver = tissue.solver
    body = StepwiseTissue(solver.nodes, solver.moduli, times=tissue.times_s, fractions=fractions)
    state, steps = body.rest, [round(end / dt) for end in ends]
    for step in range(1, steps[-1] + 1):
        forces = np.moveaxis(forces_at(step * dt).astype(float), 0, -1)
        state = body.step(state, forces, dt)
        if step in steps:
            yield np.moveaxis(state.displacement, -1, 0)


def errors_of(expected, tissue, forces_at, ends, dt=None, **keywords):
    states = through(tissue, forces_at, ends, dt, **keywords)
    return [away(state, each) for state, each in zip(states, expected, strict=False)]


def test_uniform_relaxation_is_the_stepwise_solution(backend):
    tissue = RelaxingSolver(solver_of(Material(2.0)), TWO)
    forces_at, ends = ramped(load_of(tissue.solver), 1.0), [0.5, 1.0, 1.5, 3.0]
    assert tissue.uniform
    expected = list(stepwise(tissue, TWO.fractions, forces_at, ends))
    assert max(errors_of(expected, tissue, forces_at, ends, **FINE)) < 1e-4
    assert max(errors_of(expected, tissue, forces_at, ends[:2], dt=0.1, **FINE)) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["homogeneous", "body"])
def test_uniform_relaxation_is_the_stepwise_solution_on_a_finer_grid(name):
    tissue = RelaxingSolver(solver_of(labelled_cube(name, voxels=48), 9), TWO)
    forces_at, ends = ramped(load_of(tissue.solver), 2.0), [1, 2, 3, 10]
    expected = list(stepwise(tissue, TWO.fractions, forces_at, ends))
    assert max(errors_of(expected, tissue, forces_at, ends, **FINE)) < 1e-4


def test_tissues_that_relax_differently_are_the_stepwise_solution(backend):
    tissue = RelaxingSolver(solver_of(relaxing_cube("layers")))
    forces_at, ends = ramped(load_of(tissue.solver), 0.5), [0.24, 0.5, 0.6, 2.0]
    assert not tissue.uniform and tissue.times_s == (0.1, 1, 10, 100)
    expected = list(stepwise(tissue, fractions_of(tissue.solver), forces_at, ends))
    assert max(errors_of(expected, tissue, forces_at, ends, **FINE)) < 1e-3
    assert max(errors_of(expected, tissue, forces_at, ends[:3], dt=0.05, **FINE)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["layers", "body"])
def test_a_ramp_and_a_hold_at_the_pace_of_frames(name):
    """One iteration a frame, or a tenth of a second; then as many as the solver takes by itself, and to the end."""
    tissue = RelaxingSolver(solver_of(relaxing_cube(name), 9))
    forces_at, ends = ramped(load_of(tissue.solver), 2.0), [1.0, 2.0, 5.0, 10.0]
    expected = list(stepwise(tissue, fractions_of(tissue.solver), forces_at, ends))
    for keywords in ({"dt": 1 / 60, "budget": 1}, {"dt": 0.1}, {}):
        errors = errors_of(expected, tissue, forces_at, ends, **keywords)
        assert max(errors[:2]) < 0.04 and max(errors[2:]) < 0.0125
    slow = errors_of(expected, tissue, forces_at, ends, dt=0.1, budget=1)
    assert slow[2] < 0.01 and slow[3] < 0.005
    assert max(errors_of(expected, tissue, forces_at, ends, **FINE)) < 2e-3


def test_tissues_of_one_series_move_as_uniform_tissue():
    """By nodal fields instead of forces: another way to the same displacement."""
    solver = solver_of(labelled_cube("layers", voxels=48))
    cells = np.full((1, *solver.moduli.shear.shape), 1.0)
    uniform, tissue = RelaxingSolver(solver, TWO), RelaxingSolver(solver, TWO)
    tissue._relaxation = TissueRelaxation(solver, [TWO, TWO], np.concatenate([0.25 * cells, 0.75 * cells]))
    forces, ends = load_of(solver), [0.0, 0.05, 0.1, 2.0, 60.0]
    one, other = (list(through(each, lambda time: forces, ends, **FINE)) for each in (tissue, uniform))
    for found, expected in zip(one, other, strict=True):
        assert away(found, expected.solution.displacement) < 3e-3
    assert tissue.jump(0.1) == pytest.approx(uniform.jump(0.1), rel=1e-2)


@pytest.mark.parametrize("exponent", [0.05, 0.25])
def test_forces_that_hold_a_displacement_fall_by_the_series(exponent):
    """Forces are found from where the tissue creeps to and how it answers, as contact finds them."""
    tissue = RelaxingSolver(solver_of(Material(relaxation_exponent=exponent)))
    forces = load_of(tissue.solver)
    state = tissue.advance(tissue.rest, forces, 0.0, **FINE)
    place = np.unravel_index(np.abs(state.solution.displacement).argmax(), forces.shape)
    held, amount, time = state.solution.displacement[place], 1.0, 0.0
    series = PronySeries.power_law(exponent)
    for dt in 0.02 * 1.2 ** np.arange(40):
        crept = tissue.advance(state, state.forces, dt, **FINE).solution.displacement[place]
        amount, time = amount + (held - crept) / (held * tissue.jump(dt)), time + dt
        state = tissue.advance(state, np.float32(amount) * forces, dt, **FINE)
        assert state.solution.displacement[place] == pytest.approx(held, rel=1e-3)
        assert amount == pytest.approx(float(series.modulus(time)), rel=0.01)
    assert time > 100


@pytest.mark.slow
@settings(max_examples=6)
@given(st.lists(st.floats(0.01, 1), min_size=1, max_size=4), st.floats(0.01, 60), st.booleans())
def test_the_answer_does_not_depend_on_how_time_is_cut(cuts, dt, uniform):
    tissue = UNIFORM if uniform else DIFFERENT
    forces = load_of(tissue.solver)
    start = tissue.advance(tissue.rest, forces, 0.0, **FINE)
    whole = tissue.advance(start, 1.5 * forces, dt, **FINE).solution.displacement
    ends = np.cumsum(cuts) / np.sum(cuts)
    state = start
    for before, end in zip([0, *ends], ends, strict=False):
        state = tissue.advance(state, np.float32(1 + 0.5 * end) * forces, (end - before) * dt, **FINE)
    assert away(state, whole) < (3e-5 if uniform else 2e-3)


UNIFORM = RelaxingSolver(solver_of(Material(relaxation_exponent=0.2)))
DIFFERENT = RelaxingSolver(solver_of(relaxing_cube("layers")))


@pytest.mark.parametrize("exponents", [(0.0, 0.0), (0.25, 0.0), (0.2, 0.2)])
def test_a_step_without_time_is_the_elastic_solver_bit_for_bit(exponents):
    elastic = solver_of(labelled_cube("sphere", voxels=48))
    tissue, forces = RelaxingSolver(solver_of(relaxing_cube("sphere", exponents))), load_of(elastic)
    forces[0, 0] = -0.0
    state, plain = tissue.rest, elastic.rest
    for factor in np.float32([0.3, 0.7, 1.0, 1.0, 0.0, 0.5]):
        state, plain = tissue.advance(state, factor * forces, 0.0), elastic.advance(plain, factor * forces)
        assert state.solution == plain
    assert tissue.uniform == (len(set(exponents)) == 1)


def test_tissue_that_does_not_relax_is_the_elastic_solver_whatever_the_time():
    elastic = solver_of(labelled_cube("layers", voxels=48))
    tissue, forces = RelaxingSolver(elastic), load_of(elastic)
    state, plain = tissue.rest, elastic.rest
    for factor, dt in ((0.5, 0.1), (1.0, 60.0), (1.0, 1 / 60)):
        state, plain = tissue.advance(state, factor * forces, dt), elastic.advance(plain, factor * forces)
        assert state.solution == plain
    assert tissue.times_s == () and tissue.jump(1.0) == 1


@pytest.mark.parametrize("tissue", [UNIFORM, DIFFERENT], ids=["uniform", "different"])
def test_in_the_end_tissue_is_as_soft_as_its_long_term_modulus(tissue):
    """And when the forces are gone it comes back."""
    forces = load_of(tissue.solver)
    state = tissue.advance(tissue.advance(tissue.rest, forces, 0.0), forces, 1e5, **FINE)
    soft = tissue.effective(1e9).equilibrium(forces, tolerance=1e-5).displacement
    assert away(state, soft) < 2e-3
    left = tissue.advance(tissue.advance(state, 0 * forces, 0.0, **FINE), 0 * forces, 1e5, **FINE)
    assert np.abs(left.solution.displacement).max() < 2e-3 * np.abs(soft).max()


@pytest.mark.parametrize("tissue", [UNIFORM, DIFFERENT], ids=["uniform", "different"])
def test_an_answer_to_a_change_is_that_of_the_effective_solver(tissue):
    forces, dt = load_of(tissue.solver), 0.05
    state = tissue.advance(tissue.rest, forces, 0.0, **FINE)
    unchanged, more = (tissue.advance(state, f * forces, dt, **FINE).solution.displacement for f in np.float32([1, 2]))
    expected = tissue.effective(dt).equilibrium(forces, tolerance=1e-5).displacement
    assert np.abs(more - unchanged - expected).max() < 1e-3 * np.abs(expected).max()
    elastic = tissue.solver.equilibrium(forces, tolerance=1e-5).displacement
    ratio = np.linalg.norm(expected) / np.linalg.norm(elastic)
    assert tissue.jump(dt) == pytest.approx(ratio, rel=1e-3 if tissue.uniform else 0.05)
    assert away(tissue.predicted(state, dt), unchanged) < 0.02


@pytest.mark.parametrize("tissue", [UNIFORM, DIFFERENT], ids=["uniform", "different"])
def test_states_are_values_and_a_solver_goes_on_after_it_was_pickled(tissue):
    forces = load_of(tissue.solver)
    state = tissue.advance(tissue.rest, forces, 0.5)
    again, kept = pickle.loads(pickle.dumps((tissue, state)))
    assert kept == state and hash(kept) == hash(state) and kept != tissue.rest
    before = pickle.dumps(state)
    assert again.advance(kept, 0.5 * forces, 0.3) == tissue.advance(state, 0.5 * forces, 0.3)
    assert pickle.loads(before) == state
    with pytest.raises(ValueError, match="read-only"):
        kept.history[:] = 0
    for array in (state.history, state.forces, state.solution.displacement):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0
    forces *= 2
    assert pickle.loads(before) == state


def test_a_step_that_breaks_down_keeps_the_state(monkeypatch):
    forces = load_of(DIFFERENT.solver)
    state = DIFFERENT.advance(DIFFERENT.rest, forces, 0.1)
    before = pickle.dumps(state)
    with pytest.raises(NotConvergedError):
        DIFFERENT.advance(state, np.full_like(forces, np.nan), 0.1)
    assert pickle.loads(before) == state
    assert np.isfinite(DIFFERENT.advance(state, forces, 0.1).solution.displacement).all()


class Counting:
    """A core whose calls are counted."""

    def __init__(self, core, counts):
        self._core, self._counts = core, counts

    def __getattr__(self, name):
        if name == "ElasticMultigrid":
            return lambda *args, **keywords: Counting(self._core.ElasticMultigrid(*args, **keywords), self._counts)
        found = getattr(self._core, name)

        def counted(*args):
            self._counts.append((name, args[2] if name == "iterate" else 1))
            return found(*args)

        return counted


@pytest.mark.parametrize(("exponents", "products"), [((0.1,) * 3, 0), ((0.1, 0.2, 0.0), 2), ((0.1, 0.2, 0.05), 3)])
def test_a_frame_costs_one_iteration_and_a_product_for_each_series(exponents, products, monkeypatch):
    counts = []
    monkeypatch.setattr(_core, "active", Counting(_core.active, counts))
    tissue = RelaxingSolver(solver_of(relaxing_cube("layers", exponents)))
    forces = load_of(tissue.solver)
    state = tissue.advance(tissue.advance(tissue.rest, forces, 0.1), forces, 0.1)
    counts.clear()
    for jitter in (0.9, 1.0, 1.3):
        state = tissue.advance(state, state.forces, jitter / 60, budget=1)
    assert sum(number for name, number in counts if name == "iterate") == 3
    assert len([name for name, _ in counts if name == "product"]) == 3 * products


@pytest.mark.slow
def test_operators_are_made_for_few_lengths_of_step(rng):
    tissue = RelaxingSolver(solver_of(relaxing_cube("layers")))
    forces = load_of(tissue.solver)
    state = tissue.rest
    for dt in [0.0, 1 / 60, *10 ** rng.uniform(-3, 2, 20)]:
        state = tissue.advance(state, forces, dt)
    assert set(tissue._relaxation._solvers) <= {0.0, *tissue.times_s}


CUBE = labelled_cube("layers", voxels=48)


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        (lambda: UNIFORM.advance(UNIFORM.rest, UNIFORM.rest.forces, -0.1), r"dt = -0.1 is out of range; give a finite"),
        (lambda: UNIFORM.advance(UNIFORM.rest, UNIFORM.rest.forces, np.nan), "dt = nan is out of range; give"),
        (lambda: UNIFORM.jump(-1), "dt = -1 is out of range; give"),
        (lambda: UNIFORM.advance(UNIFORM.rest, np.zeros((3, 4, 4, 4)), 0.1), r"forces has shape \(3, 4, 4, 4\); give"),
        (lambda: RelaxingSolver("liver"), "solver = 'liver' is not an ElasticSolver; make one"),
        (lambda: RelaxingSolver(UNIFORM.solver, {0: TWO}), "is for labels, and the tissue is one; give a PronySeries"),
        (lambda: RelaxingSolver(solver_of(CUBE), 0.2), "series = 0.2 is none; give a PronySeries, or one for each"),
        (lambda: RelaxingSolver(solver_of(CUBE), {0: TWO}), r"series has none for labels \[1, 2\]; give PronySeries()"),
        (lambda: RelaxingSolver(solver_of(CUBE), {0: TWO, 1: 3, 2: TWO}), r"series\[1\] = 3 is none; give a Prony"),
        (
            lambda: RelaxingSolver(solver_of(CUBE), {0: TWO, 1: TWO, 2: PronySeries((0.1,), (2,))}),
            r"times_s = \(0.5, 10.0\) and \(2.0,\) differ between labels; give shared time constants",
        ),
    ],
)
def test_bad_input_is_one_clear_line(wrong, problem):
    with pytest.raises(ValueError, match=problem) as error:
        wrong()
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("contact", ["pose", "track"])
def test_an_exponent_counts_only_where_tissue_is_to_relax(contact):
    """Bit for bit: tables may give exponents."""
    tissue, found = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5)), []
    for exponent in (0.0, 0.1):
        material = Material(10.0, relaxation_exponent=exponent)
        model = ElasticModel(tissue, material, contact=contact, nodes=9**3)
        state = model.rest
        for depth in (20.0, 45.0, 30.0):
            response = model.step(state, {"needle": ss.Needle((0, 50, 50), (depth, 50, 50))}, 0.5)
            state = response.state
        found.append((state.solution.displacement, response.forces["needle"]))
    assert np.array_equal(found[0][0], found[1][0]) and found[0][1] == found[1][1]

"""Every linear system is solved as it is where it is sound, and refused or bounded where it is not."""

import numpy as np
import pytest
from scipy.sparse import diags_array

import sonospline as ss
from sonospline import _definite
from sonospline._core import cubic_axis
from sonospline.elasticity import ElasticSolver
from sonospline.fem.held_shaft import held_shaft
from sonospline.fem.sparse_solvers import Solver, conjugate_gradients
from sonospline.mechanics import Material, Moduli, ShaftDisplacement


def test_a_sound_system_is_solved_as_it_is(rng):
    root = rng.normal(size=(8, 8))
    matrix, right = root @ root.T + np.eye(8), rng.normal(size=8)
    np.testing.assert_allclose(matrix @ _definite.solve(matrix, right, most=np.inf), right, rtol=1e-10)
    assert _definite.factor(matrix)[1] == pytest.approx(1 / np.linalg.cond(matrix, 1), rel=0.5)
    assert _definite.factor(-matrix)[1] == 0


@pytest.mark.parametrize("smallest", [1e-6, 1e-13, 0.0, -1e-17])
def test_an_answer_keeps_to_its_energy(rng, smallest):
    axes, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    matrix, right = axes * [1, 0.5, 0.1, 1e-2, 1e-4, smallest] @ axes.T, rng.normal(size=6)
    for most in (1e-3, 1.0, 10.0):
        found = _definite.solve(matrix, right, most=most)
        assert found @ matrix @ found == pytest.approx(most, rel=1e-6)


def test_conjugate_gradients_say_that_they_broke_down():
    matrix = diags_array([1.0, -1.0, 2.0])
    with pytest.raises(RuntimeError, match=r"conjugate gradients broke down \(curvature .*use solver='direct'"):
        conjugate_gradients(matrix, np.array([1.0, 2.0, 0.1]), lambda residual: residual, 1e-9)
    with pytest.raises(RuntimeError, match="broke down"):
        conjugate_gradients(matrix, np.array([1.0, np.nan, 0.1]), lambda residual: residual, 1e-9)


class Wrong(Solver):
    """A factor that has lost everything to rounding."""

    exact = True

    def apply(self, residual):
        return 0.9 * residual


def test_a_factor_that_does_not_solve_its_system_is_an_error():
    with pytest.raises(RuntimeError, match=r"the factor leaves a residual of 1.0e-01: the system is singular"):
        Wrong().solve(diags_array([1.0, 1.0]), np.array([1.0, 2.0]), 1e-9)


@pytest.mark.parametrize("stiffness", [1e-30, 1e30])
def test_stiffness_beyond_single_precision_is_refused(stiffness):
    with pytest.raises(ValueError, match=r"shear moduli from .* are beyond the solver's range; give stiffness in kPa"):
        ElasticSolver(ss.Tissue(ss.Grid.unit_cube(5)), Material(stiffness), nodes=125)


def test_moduli_at_the_ends_of_their_range_are_solved():
    grid = ss.Grid.unit_cube(9)
    shear = np.full((8, 8, 8), 1e12)
    shear[:4] = 1e6
    Moduli(grid, shear, shear)
    solver = ElasticSolver(ss.Tissue(grid), Material(3e-9), nodes=9**3)
    forces = np.zeros((3, 9, 9, 9))
    forces[0, 4, 4, 4] = 1e-9
    assert 0 < np.abs(solver.equilibrium(forces).displacement).max() < 10


def test_a_shaft_that_holds_nodes_it_cannot_tell_apart_is_refused(monkeypatch):
    solver = ElasticSolver(ss.Tissue(ss.Grid.unit_cube(5)), nodes=125)
    alike = solver.rest
    monkeypatch.setattr(solver, "equilibrium", lambda forces, *, tolerance: alike)
    with pytest.raises(ValueError, match=r"load = .* holds \d+ nodes that cannot be told apart; give a smaller radius"):
        held_shaft(solver, ShaftDisplacement(), ss.Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5)))


@pytest.mark.parametrize("nodes", [2, 3, 4, 5, 10, 100])
def test_cubics_between_nodes_are_well_conditioned(nodes):
    assert np.linalg.cond(cubic_axis.filter_matrix(nodes)) < 10

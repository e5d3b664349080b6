"""Faces that are pinned or free by choice, and held nodes that are moved: against scikit-fem and exact solutions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import spsolve

import sonospline as ss
from elastic_problems import GRADIENT, system_of
from sonospline import models
from sonospline.elasticity import ElasticSolver, driven
from sonospline.fem.scikit import ScikitFem
from sonospline.fem.scikit_assembly import assemble
from sonospline.mechanics import LineForce, Material, labelled_cube

GRID = ss.Grid(shape=(13, 13, 13), spacing=100 / 12)


def by_scikit_fem(solver, held):
    """The same problem, its held nodes prescribed."""
    prescribed = np.moveaxis(held, 0, -1).reshape(-1, 3).astype(float)
    found, _ = ScikitFem(system_of(solver)).solve(np.zeros_like(prescribed), prescribed)
    return np.moveaxis(found.reshape(*solver.grid.shape, 3), -1, 0)


def relative(found, exact):
    return np.abs(found - exact).max() / np.abs(exact).max()


@given(faces=st.sets(st.sampled_from(ss.FACES), min_size=1), entry=st.sampled_from(ss.FACES))
def test_a_tissue_holds_the_faces_it_is_given(faces, entry):
    tissue = ss.Tissue(GRID, entry, pinned_faces=tuple(faces))
    assert set(tissue.pinned_faces) == faces
    assert set(tissue.free_faces) == set(ss.FACES) - faces
    assert np.array_equal(tissue.pinned, GRID.on_faces(tuple(faces)))


def test_the_five_faces_of_old_are_the_default():
    named = ss.Tissue(GRID, "x-", pinned_faces=("z+", "z-", "y+", "y-", "x+"))
    assert named == ss.Tissue(GRID, "x-") and repr(named) == repr(ss.Tissue(GRID, "x-"))


def test_an_unknown_face_is_refused():
    with pytest.raises(ValueError, match="pinned_faces = 'skin' is not known; choose one of x-"):
        ss.Tissue(GRID, "x-", pinned_faces=("skin",))


@pytest.mark.parametrize("scene", ["layers", "bone"])
@pytest.mark.parametrize("pinned", [("x+",), ("x-", "x+", "z-")])
def test_given_displacements_of_held_nodes_as_scikit_fem_has_them(scene, pinned):
    tissues = labelled_cube(scene, side=100, stiffness_kpa=10)
    solver = ElasticSolver(ss.Tissue(GRID, "z-", pinned_faces=pinned), tissues, nodes=13**3)
    rng = np.random.default_rng(1)
    held = rng.normal(size=(3, *solver.grid.shape)) * (solver.free == 0)
    held[0, -1] += 10.0
    assert relative(driven(solver, held), by_scikit_fem(solver, held)) < 1e-3


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(scale=st.floats(-1e3, 1e3).filter(lambda s: abs(s) > 1e-3), shift=st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_linear_displacement_of_the_walls_goes_through(scale, shift):
    solver = ElasticSolver(ss.Tissue(GRID, pinned_faces=ss.FACES), Material(10.0), nodes=13**3)
    exact = scale * (GRID.points / 100 @ GRADIENT.T) + np.array(shift)
    exact = np.moveaxis(exact.reshape(*GRID.shape, 3), -1, 0)
    assert np.abs(driven(solver, exact) - exact).max() <= 1e-3 * np.abs(exact).max()


def test_walls_that_move_as_a_whole_carry_all_tissue_along():
    solver = ElasticSolver(ss.Tissue(GRID, "z-", pinned_faces=("x-",)), Material(10.0), nodes=13**3)
    moved = np.broadcast_to(np.array([1.0, -2.0, 3.0])[:, None, None, None], (3, *GRID.shape))
    assert np.abs(driven(solver, moved) - moved).max() < 1e-3
    assert not driven(solver, 0 * moved).any()


def test_walls_that_are_no_array_of_the_grid_are_refused():
    solver = ElasticSolver(ss.Tissue(GRID), Material(10.0), nodes=13**3)
    with pytest.raises(ValueError, match=r"held has shape \(3, 2, 2, 2\); give displacements of shape \(3, 13, 13"):
        driven(solver, np.zeros((3, 2, 2, 2)))
    held = np.zeros((3, *GRID.shape))
    held[0, -1] = np.nan
    with pytest.raises(ValueError, match="held contains NaN or infinity"):
        driven(solver, held)


@pytest.mark.slow
def test_a_needle_moves_tissue_with_free_sides_as_scikit_fem_has_it():
    solver = ElasticSolver(ss.Tissue(GRID, "x-", pinned_faces=("x+", "y+")), Material(10.0), nodes=13**3)
    load, needle = LineForce.for_cube(100), ss.Needle((0, 50, 50), (60, 50, 50))
    forces = solver.nodal_load(load, needle)
    free = solver.free.ravel() > 0
    exact = np.zeros((free.size, 3))
    at_nodes = np.moveaxis(forces, 0, -1).reshape(-1, 3)[free]
    exact[free] = spsolve(assemble(system_of(solver)).free.tocsc(), at_nodes.ravel()).reshape(-1, 3)
    exact = np.moveaxis(exact.reshape(*GRID.shape, 3), -1, 0)
    assert relative(solver.solve(load, needle).displacement, exact) < 1e-3
    assert np.abs(exact[:, :, 0]).max() > 0.2 * np.abs(exact).max()  # the free side y- has moved


def test_models_that_differ_in_their_pins_know_each_other_s_states_apart():
    grid = ss.Grid.unit_cube(9)
    some, all_but_one = ss.Tissue(grid, "z-", pinned_faces=("x-", "x+", "z+")), ss.Tissue(grid, "z-")
    for name in ("paper", "kelvinlet", "elastic"):
        one, other = (models.make(name, tissue) for tissue in (some, all_but_one))
        assert one.identity != other.identity, name
        with pytest.raises(ValueError, match="state"):
            other.step(one.rest, {"needle": ss.Needle((0.5, 0.5, 0), (0.5, 0.5, 0.4))})


def test_all_nodes_of_faces_that_no_reflection_maps_on_each_other_are_refused():
    lopsided = ss.Tissue(ss.Grid.unit_cube(9), "z-", pinned_faces=("x+", "y-"))
    with pytest.raises(ValueError, match=r"anchors = 'all' needs opposite faces .* give a number of anchors"):
        models.make("paper", lopsided, anchors="all")

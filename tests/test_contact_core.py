"""Forces of contact, and the displacement of the points that they act at, in the core and its twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from scipy.optimize import lsq_linear

import sonospline as ss
from builds import INSTRUCTION_SETS, needs_core
from sonospline import _core
from sonospline._core import cubic_axis
from sonospline._core.twin import contact as twin_contact
from sonospline._core.twin import elastic_inverse as twin_inverse
from sonospline.contact import Medium
from sonospline.contact.laying import giving_way
from sonospline.elasticity import ElasticSolver
from sonospline.mechanics import Material


def shaft_compliance(n, rng, apart=0.5):
    """Of points along a line: positive definite, and as smooth as that of a shaft."""
    places = apart * np.arange(n)
    smooth = 1 / np.hypot(1.0, places[:, None] - places)
    return smooth + np.diag(0.05 * rng.random(n) + 0.02)


@settings(max_examples=60, deadline=None)
@given(n=st.integers(1, 30), seed=st.integers(0, 10**6))
def test_forces_within_bounds_are_those_of_a_least_squares_solver(n, seed):
    rng = np.random.default_rng(seed)
    compliance, apart = shaft_compliance(n, rng), rng.normal(size=n)
    low, high = -rng.random(n), rng.random(n)
    found, sweeps = _core.active.clipped_forces(compliance, apart, low, high, np.zeros(n), 20_000, 1e-12)
    assert sweeps < 20_000
    root = np.linalg.cholesky(compliance)
    wanted = lsq_linear(root.T, np.linalg.solve(root, -apart), (low - 1e-12, high + 1e-12), tol=1e-13).x
    np.testing.assert_allclose(found, wanted, atol=2e-4)
    beyond = apart + compliance @ found
    assert (beyond[found >= high] <= 1e-9).all() and (beyond[found <= low] >= -1e-9).all()
    assert np.abs(beyond[(found > low) & (found < high)]).max(initial=0.0) < 1e-9


@needs_core
def test_clipped_forces_agree_with_the_twin(native):
    rng = np.random.default_rng(1)
    arguments = shaft_compliance(20, rng), rng.normal(size=20), -rng.random(20), rng.random(20), np.zeros(20), 9, 1e-9
    ours, theirs = native.clipped_forces(*arguments), twin_contact.clipped_forces(*arguments)
    np.testing.assert_allclose(ours[0], theirs[0], atol=1e-12)
    assert ours[1] == theirs[1]


def a_shaft(m, rng):
    """Arguments of the twin for a shaft that sticks here and slides there."""
    along = shaft_compliance(m, rng)
    bounds = rng.random(m) * (rng.random(m) < 0.9)
    axial = rng.uniform(-1, 1, m) * bounds
    slides = rng.random(m) < 0.4
    axial = np.where(slides, np.sign(axial) * bounds * rng.random(m), axial)
    end = np.zeros(m)
    end[-2:] = 0.3, 0.7
    return {
        "compliance": along, "behind": rng.normal(size=m), "end": end, "bond": 0.1 * np.append(along.diagonal(), 1e-3),
        "anchors": rng.normal(size=m), "axial": axial, "tip": 0.3, "slides": slides, "bounds": bounds, "limit": 0.8,
        "slow": 0.05, "sweeps": 5000, "tolerance": 1e-12,
    }  # fmt: skip


def a_track(m, rng):
    """Arguments of the core for a needle that has gone on from where its track held it."""
    apart, cut = 0.5, 0.5 * (m - 1) * rng.random()
    along = apart * np.arange(m)
    compliance, resistance = 0.3 * shaft_compliance(m, rng), rng.random((4, m))
    resistance[1] += 1.0
    behind = cut + rng.uniform(-1, 1) - along - 0.3 * rng.random(m)
    return {
        "compliance": compliance, "behind": behind, "bond": 0.1 * np.append(compliance.diagonal(), 1e-3),
        "resistance": resistance, "anchors": behind + rng.normal(size=m) / 5, "axial": rng.normal(size=m) / 5,
        "tip": 0.1, "cut": cut, "sliding": (rng.random(m) < 0.4).astype(np.uint8),
        "used": (rng.random(m) < 0.2).astype(np.uint8), "apart": apart, "reuse": 0.6, "speed": 0.5,
        "membrane": rng.choice([np.inf, cut, cut + 0.2]), "rupture": rng.random(), "slow": 0.02, "sweeps": 50,
        "tolerance": 1e-7, "ends": 1e-3, "grown": 0.01, "most": 40,
    }  # fmt: skip


@needs_core
@settings(max_examples=100, deadline=None)
@given(m=st.integers(2, 20), seed=st.integers(0, 10**6))
def test_a_tip_cuts_on_as_in_the_twin(m, seed):
    arguments = a_track(m, np.random.default_rng(seed))
    ours, theirs = _core.native.cut_on(**arguments), twin_contact.cut_on(**arguments)
    for found, expected in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(m=st.integers(2, 20), seed=st.integers(0, 10**6))
def test_what_sticks_is_a_bond_from_its_anchor_and_what_slips_takes_it_along(m, seed):
    """Sought until no change of a force is left, so that it does not matter how slowly they are let change."""
    arguments = a_shaft(m, np.random.default_rng(seed))
    compliance, end, bond, bounds = (arguments[name] for name in ("compliance", "end", "bond", "bounds"))
    before, tip, first = arguments["axial"], arguments["tip"], arguments["behind"]
    for _ in range(200):
        behind, anchors, axial, reached = twin_contact.stick_slip(**arguments)
        change = float(np.abs(axial - arguments["axial"]).max() + abs(reached - arguments["tip"]))
        slides = (np.abs(axial) >= bounds) & (bounds > 0)
        arguments |= {"axial": axial, "tip": reached, "anchors": anchors, "behind": behind, "slides": slides}
        if change < 1e-10:
            break
    np.testing.assert_allclose(behind, first - compliance @ (axial - before + (reached - tip) * end), atol=1e-9)
    assert (np.abs(axial) <= bounds).all() and 0 <= reached <= 0.8
    np.testing.assert_allclose(anchors, behind - bond[:-1] * axial, atol=1e-6)
    ahead = -end @ behind
    assert reached == 0 or reached == 0.8 or abs(ahead + bond[-1] * reached) < 1e-6 or abs(ahead) < 1e-3


@needs_core
def test_what_holds_a_shaft_agrees_with_the_twin_and_brings_points_where_they_were():
    rng, m = np.random.default_rng(4), 9
    root, axis = rng.normal(size=(3 * m, 3 * m)), np.array([0.6, 0, 0.8])
    compliance, held = root @ root.T, (rng.random(m) < 0.7).astype(np.uint8)
    places, offsets, lateral = (rng.normal(size=(m, 3)) for _ in range(3))
    arguments = compliance, places, axis, held, offsets, lateral
    ours, theirs = (core.held_across(*arguments, 0.8, 0.1, 0.3, 1e-9) for core in (_core.native, twin_contact))
    np.testing.assert_allclose(ours[0], theirs[0], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(ours[1], theirs[1], atol=1e-12)
    forces, beside = _core.native.held_across(*arguments, 1.0, 0.0, 0.0, 0.0)
    across = np.eye(3) - np.outer(axis, axis)
    before = np.where(held[:, None], lateral @ across, 0.0)
    moved = places + (compliance @ (forces - before).ravel()).reshape(m, 3)
    np.testing.assert_allclose((moved @ across)[held != 0], (offsets @ across)[held != 0], atol=1e-8)
    np.testing.assert_allclose(beside[held == 0], (places @ across)[held == 0], atol=1e-12)
    assert not forces[held == 0].any()


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
def test_the_displacement_at_points_agrees_with_the_twin_and_with_scipy(native, isa):
    native.use_instruction_set(isa)
    shape, spacing = (13, 12, 18), (0.1, 0.09, 0.07)
    rng = np.random.default_rng(3)
    points, moved = rng.uniform(0.2, 0.8, (9, 3)) * (np.array(shape) - 1) * spacing, rng.normal(size=(3, *shape))
    filters = [cubic_axis.filter_matrix(n) for n in shape]
    arguments = moved.astype(np.float32), spacing, *filters, points
    ours, theirs = native.displacement_at(*arguments), twin_inverse.displacement_at(*arguments)
    assert np.abs(ours - theirs).max() < 2e-6
    wanted = [map_coordinates(each, (points / spacing).T, order=3, mode="nearest") for each in moved]
    assert np.abs(ours - np.stack(wanted, axis=-1)).max() < 0.05  # nodes far away are left out


def test_beyond_the_box_the_displacement_is_that_of_its_faces(backend):
    moved = np.arange(3 * 125, dtype=np.float32).reshape(3, 5, 5, 5)
    filters = [cubic_axis.filter_matrix(5)] * 3
    found = _core.active.displacement_at(moved, (1, 1, 1), *filters, np.array([[9.0, 2, 2], [4, 2, 2]]))
    np.testing.assert_allclose(found[0], found[1])


def test_a_force_beside_any_free_face_acts_in_whole():
    """What its Gaussian would have beyond a face comes back from it, at every free face."""
    grid = ss.Grid(shape=(25, 25, 25), spacing=100 / 24)
    tissue = ss.Tissue(grid, "x-", pinned_faces=("x+",))
    medium = Medium(ElasticSolver(tissue, Material(10), nodes=13**3), width=8.0)
    for place in ([30.0, 1.0, 50.0], [1.0, 50.0, 50.0], [30.0, 50.0, 98.0]):
        load = medium.nodal(np.array([place]), np.array([[0.3, -0.2, 1.0]]))
        np.testing.assert_allclose(load.sum(axis=(1, 2, 3)), [0.3, -0.2, 1.0], rtol=1e-5)


def test_a_points_own_compliance_is_above_zero_however_few_iterations_found_it():
    """A needle pushed through the kidney scene to its wall met one below, and its step failed."""
    turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    below = turned @ np.diag([3e-3, -1e-5, 2e-3]) @ turned.T
    assert np.linalg.eigvalsh(giving_way(below)).min() > 0
    np.testing.assert_allclose(giving_way(below), below, atol=1.1e-5)
    sound = turned @ np.diag([3e-3, 1e-3, 2e-3]) @ turned.T
    assert giving_way(sound) is sound

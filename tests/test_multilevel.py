"""The multilevel sum against the float64 direct sum, its own error bound and its NumPy twin."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonospline import PolyharmonicSpline
from sonospline._core import twin
from sonospline._core.twin import multilevel as twin_multilevel

native = pytest.importorskip("sonospline._core._native")

AFFINE = np.array([[0.1, -0.2, 0.3], [1, 0.5, 0], [0, -1, 0.25], [0.5, 0, 1]])


def landmarks(shape, n, seed=0):
    """Distinct lattice nodes, half of them on faces, and weights without a sum, as a fit makes them."""
    rng = np.random.default_rng(seed)
    index = rng.integers(0, shape, (n, 3))
    index[: n // 2, 0] = rng.choice([0, shape[0] - 1], n // 2)
    index = np.unique(index, axis=0)
    weights = rng.normal(size=index.shape)
    weights -= weights.sum(axis=0) / max(len(weights), 1)
    return index, weights / max(np.abs(weights).sum(axis=0).max(initial=0), 1e-300)


def direct(shape, spacing, index, weights, affine=AFFINE):
    return native.sum_on_lattice_f64(0, shape, spacing, index * np.array(spacing), weights, affine)


def unit_spacing(shape):
    return (1 / (max(shape) - 1),) * 3


def rounding(shape, spacing, weights):
    """What float32 may cost: each value, and the sum of |weights| times the diagonal, to 24 bits."""
    diagonal = np.linalg.norm((np.array(shape) + 30) * spacing)
    return 1e-6 * (np.abs(AFFINE).sum() * max(1.0, diagonal) + np.abs(weights).sum() * diagonal)


def assert_within_bound(plan, shape, spacing, index, weights, depth):
    error = np.abs(plan.evaluate(index, weights, AFFINE, depth) - direct(shape, spacing, index, weights)).max()
    bound = plan.error_per_weight(depth) * np.abs(weights).sum(axis=0).max(initial=0)
    assert error <= bound + rounding(shape, spacing, weights)


@settings(max_examples=60, deadline=None)
@given(
    shape=st.tuples(*[st.integers(2, 40)] * 3),
    n=st.integers(0, 60),
    depth=st.integers(1, 3),
    seed=st.integers(0, 1000),
)
def test_error_stays_below_its_bound_whatever_the_shape(shape, n, depth, seed):
    spacing = unit_spacing(shape)
    plan = native.MultilevelPlan(shape, spacing, 1e-4)
    assert_within_bound(plan, shape, spacing, *landmarks(shape, n, seed), depth)


@settings(max_examples=20, deadline=None)
@given(
    stretch=st.tuples(*[st.floats(1, 2)] * 3),
    shape=st.tuples(*[st.integers(2, 30)] * 3),
    depth=st.integers(1, 2),
)
def test_spacing_may_be_anisotropic(stretch, shape, depth):
    spacing = tuple(s / 30 for s in stretch)
    plan = native.MultilevelPlan(shape, spacing, 3e-4)
    assert_within_bound(plan, shape, spacing, *landmarks(shape, 40), depth)


@pytest.mark.parametrize("orders", [(4, 4), (6, 6), (8, 8), (10, 10), (12, 12)])
def test_every_parity_class_keeps_the_bound(orders):
    """One landmark at a time: nothing averages out."""
    shape, spacing = (26, 31, 70), (1.0, 1.0, 1.0)
    plan = native.MultilevelPlan(shape, spacing, 5e-3, orders)
    for parity in np.ndindex(4, 4, 4):
        index = np.add([parity], [8, 8, 24])
        for depth in (1, 2):
            assert_within_bound(plan, shape, spacing, index, np.ones((1, 3)), depth)


@pytest.mark.parametrize("nodes", [25, 48, 53])
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_default_setting_is_good_to_1e_5_of_the_side(nodes, depth, fitted_case):
    shape, spacing, index, weights, affine = fitted_case(nodes, 300)
    expected = direct(shape, spacing, index, weights, affine)
    result = native.MultilevelPlan(shape, spacing).evaluate(index, weights, affine, depth)
    assert np.abs(result - expected).max() < 1e-5


def test_accurate_setting_is_good_to_1e_6_of_the_side(fitted_case):
    shape, spacing, index, weights, affine = fitted_case(53, 300)
    plan = native.MultilevelPlan(shape, spacing, 2e-6, (8, 8))
    expected = direct(shape, spacing, index, weights, affine)
    assert np.abs(plan.evaluate(index, weights, affine, 2) - expected).max() < 1e-6


@pytest.mark.parametrize("name", native.instruction_sets())
@pytest.mark.parametrize("shape", [(21, 22, 23), (9, 40, 17)])
def test_instruction_sets_agree(name, shape, restored_core):
    index, weights = landmarks(shape, 80)
    plan = native.MultilevelPlan(shape, unit_spacing(shape), 1e-4)
    expected = plan.evaluate(index, weights, AFFINE, 2)
    native.use_instruction_set(name)
    np.testing.assert_allclose(plan.evaluate(index, weights, AFFINE, 2), expected, rtol=0, atol=2e-6)


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("shape", [(53, 53, 53), (5, 90, 33), (90, 5, 2)])
def test_cutting_for_any_number_of_threads_changes_no_bit(threads, shape, restored_core):
    index, weights = landmarks(shape, 200)
    plan = native.MultilevelPlan(shape, unit_spacing(shape), 1e-4)
    expected = plan.evaluate(index, weights, AFFINE, 2)
    native.set_thread_count(threads)
    np.testing.assert_array_equal(plan.evaluate(index, weights, AFFINE, 2), expected)


@pytest.mark.parametrize("depth", [1, 2])
@pytest.mark.parametrize(
    ("shape", "spacing"),
    [((12, 17, 20), (0.05, 0.05, 0.05)), ((2, 9, 14), (0.08, 0.1, 0.07)), ((33, 8, 3), (0.03,) * 3)],
)
def test_twin_does_the_same(shape, spacing, depth):
    index, weights = landmarks(shape, 50)
    plans = [module.MultilevelPlan(shape, spacing, 3e-4) for module in (native, twin_multilevel)]
    compiled, numpy = (plan.evaluate(index, weights, AFFINE, depth) for plan in plans)
    np.testing.assert_allclose(compiled, numpy, rtol=0, atol=1e-6)
    assert plans[0].error_per_weight(depth) == pytest.approx(plans[1].error_per_weight(depth))


def test_twin_keeps_the_bound_with_three_levels():
    shape, spacing = (20, 14, 11), (0.05,) * 3
    index, weights = landmarks(shape, 30)
    plan = twin_multilevel.MultilevelPlan(shape, spacing, 1e-3)
    expected = twin.sum_on_lattice_f64(0, shape, spacing, index * np.array(spacing), weights, AFFINE)
    assert np.abs(plan.evaluate(index, weights, AFFINE, 3) - expected).max() <= plan.error_per_weight(3)


def test_depth_grows_with_the_work_and_tiny_grids_are_left_to_the_direct_sum():
    for module in (native, twin_multilevel):
        assert module.MultilevelPlan((3, 4, 5), (0.2,) * 3).depth(10) == 0
        assert module.MultilevelPlan((53,) * 3, (1 / 52,) * 3, 3e-4).depth(1000) >= 1
    assert native.MultilevelPlan((216,) * 3, (1 / 215,) * 3).depth(3000) == 3


def test_result_goes_where_it_is_wanted():
    shape = (10, 11, 12)
    index, weights = landmarks(shape, 20)
    plan = native.MultilevelPlan(shape, unit_spacing(shape))
    out = np.full((*shape, 3), np.nan, np.float32)
    plan.evaluate(index, weights, AFFINE, out=out)
    np.testing.assert_array_equal(out, plan.evaluate(index, weights, AFFINE))


def test_one_plan_serves_several_threads():
    shape = (30, 30, 30)
    plan = native.MultilevelPlan(shape, unit_spacing(shape))
    cases = [landmarks(shape, 100, seed) for seed in range(8)]
    expected = [plan.evaluate(*case, AFFINE) for case in cases]
    with ThreadPoolExecutor(4) as pool:
        for result, known in zip(pool.map(lambda case: plan.evaluate(*case, AFFINE), cases), expected, strict=True):
            np.testing.assert_array_equal(result, known)


@pytest.mark.parametrize("module", [native, twin_multilevel])
def test_what_does_not_fit_is_refused(module):
    plan = module.MultilevelPlan((8, 9, 10), (0.1,) * 3, 1e-2)
    weights = np.ones((1, 3))
    with pytest.raises(ValueError, match="outside the lattice"):
        plan.evaluate(np.array([[0, 9, 0]]), weights, AFFINE)
    with pytest.raises(ValueError, match="differ in length"):
        plan.evaluate(np.zeros((2, 3), np.int64), weights, AFFINE)
    with pytest.raises(ValueError, match="max_depth"):
        plan.evaluate(np.zeros((1, 3), np.int64), weights, AFFINE, 4)
    with pytest.raises(ValueError, match="shape"):
        plan.evaluate(np.zeros((1, 3), np.int64), weights, AFFINE, 1, np.zeros((8, 9, 9, 3), np.float32))
    with pytest.raises(ValueError, match="orders"):
        module.MultilevelPlan((8, 9, 10), (0.1,) * 3, 1e-2, (5,))
    with pytest.raises(ValueError, match="anisotropic"):
        module.MultilevelPlan((8, 9, 10), (0.1, 0.1, 1.5), 1e-5)


@pytest.fixture
def restored_core():
    name, threads = native.instruction_set(), native.thread_count()
    yield
    native.use_instruction_set(name)
    native.set_thread_count(threads)


@pytest.fixture(scope="session")
def fitted_case():
    """Half the landmarks held on five faces, half pushed along a tube around the axis."""

    def case(nodes, n):
        rng = np.random.default_rng(nodes)
        faces = rng.integers(0, nodes, (n // 2, 3))
        axis, side = np.array([(1, 0), (1, 1), (2, 0), (2, 1), (0, 1)])[rng.integers(0, 5, n // 2)].T
        faces[np.arange(n // 2), axis] = side * (nodes - 1)
        around = rng.normal(0.5, 0.06, (n, 2))
        tube = np.rint(np.column_stack([rng.uniform(0.02, 0.6, n), around]) * (nodes - 1)).astype(np.int64)
        tube = np.unique(tube, axis=0)
        index = np.unique(np.concatenate([faces, rng.permutation(tube)[: n - n // 2]]), axis=0)
        points = index / (nodes - 1)
        off_axis = points[:, 1:] - 0.5
        decay = np.exp(-0.5 * (off_axis**2).sum(axis=1) / 0.1291**2) * (np.abs(off_axis).max(axis=1) < 0.4)
        push = np.column_stack([0.0227 * decay, -0.1 * off_axis * decay[:, None]])
        push[(points[:, 0] == 1) | (np.abs(off_axis).max(axis=1) > 0.49)] = 0
        field = PolyharmonicSpline.fit(points, push)
        affine = np.vstack([field.affine[0] - field.reference @ field.affine[1:], field.affine[1:]])
        return (nodes,) * 3, (1 / (nodes - 1),) * 3, index, np.ascontiguousarray(field.weights), affine

    return case

"""A needle's field carried along by a background: against brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import root

import sonospline as ss

GRID = ss.Grid(shape=(13, 12, 11), spacing=(8.0, 9.0, 10.0), origin=(5, -3, 2))
TURNED = ss.Grid(
    shape=(11, 11, 11), spacing=10.0, origin=(10, 0, 0), direction=((0.8, -0.6, 0), (0.6, 0.8, 0), (0, 0, 1))
)


def smooth(seed, largest_mm, lattice=GRID, order=3):
    """A random field, as smooth as its gradient has to stay below a half."""
    rng = np.random.default_rng(seed)
    values = gaussian_filter(rng.normal(size=(*lattice.shape, 3)), (2.5, 2.5, 2.5, 0), mode="nearest")
    values *= largest_mm / np.abs(values).max()
    return ss.GridField(GRID, values.astype(np.float32), lattice=lattice, order=order)


def inside(seed, count=20):
    return GRID.world(GRID.extent * (0.2 + 0.6 * np.random.default_rng(seed).random((count, 3))))


seeds = st.integers(0, 1000)
fields = st.builds(
    ss.CarriedField,
    st.builds(smooth, seeds, st.floats(0.1, 6), st.sampled_from([GRID, TURNED]), st.sampled_from([1, 3])),
    st.builds(smooth, seeds, st.floats(0.1, 12), st.sampled_from([GRID, TURNED]), st.sampled_from([1, 3])),
)


@given(field=fields, seed=seeds)
def test_it_is_one_map_after_the_other(field, seed):
    p = inside(seed)
    between = p + field.inner.displacement(p)
    assert field.forward(p) == pytest.approx(between + field.background.displacement(between), abs=1e-9)
    assert field.displacement(p[0]).shape == (3,) and field.jacobian(p[0]).shape == (3, 3)
    assert field.displacement(p[3]) == pytest.approx(field.displacement(p)[3], abs=1e-4)


@given(field=fields, seed=seeds)
def test_the_inverse_undoes_it_where_a_root_finder_does(field, seed):
    p = inside(seed, 3)
    back, report = field.inverse(p, return_report=True)
    assert report.converged.all() and report.residual <= field.inverse_tolerance * field.length
    assert np.abs(field.forward(back) - p).max() <= 1e-3
    for target, found in zip(p, back, strict=True):
        solved = root(lambda x, target=target: field.forward(x) - target, target, tol=1e-6)
        if solved.success:
            assert np.abs(solved.x - found).max() < 0.02  # linear fields have kinks


@settings(max_examples=30)
@given(field=fields, seed=seeds)
def test_the_jacobian_is_the_slope_of_the_map(field, seed):
    p = inside(seed, 5)
    if field.inner.order == 1 or field.background.order == 1:
        product = field.background.jacobian(field.inner.forward(p)) @ field.inner.jacobian(p)
        assert field.jacobian(p) == pytest.approx(product)
        return
    h = 0.05
    slopes = [(field.forward(p + h * e) - field.forward(p - h * e)) / (2 * h) for e in np.eye(3)]
    assert field.jacobian(p) == pytest.approx(np.stack(slopes, axis=-1), abs=5e-3)


@settings(max_examples=20)
@given(field=fields)
def test_on_the_grid_it_is_what_it_is_at_points(field):
    at_points = field.displacement(GRID.points).reshape(*GRID.shape, 3)
    assert field.on_grid() == pytest.approx(at_points, abs=1e-4)
    assert np.abs(ss.GridField.of(field).displacement(GRID.points) - field.displacement(GRID.points)).max() < 1e-3


def test_a_linear_background_is_applied_where_the_needle_has_brought_tissue():
    needle = smooth(1, 5.0)
    slope = np.array([[0.1, 0, 0.05], [0, -0.04, 0], [0.02, 0, 0.03]])
    background = ss.GridField(GRID, (GRID.points @ slope.T).reshape(*GRID.shape, 3))
    field, p = ss.CarriedField(needle, background), inside(2)
    u = needle.displacement(p)
    assert field.displacement(p) == pytest.approx(u + (p + u) @ slope.T, abs=1e-4)
    beside = field.displacement(p) - (u + p @ slope.T)  # of the sum
    assert beside == pytest.approx(u @ slope.T, abs=1e-4) and np.abs(beside).max() > 0.05


def test_sampled_by_scipy_it_is_the_same_map():
    field = ss.CarriedField(smooth(3, 4.0, order=1), smooth(4, 12.0, order=1))

    def sampled(one, p):
        index = (GRID.local(p) / GRID.spacing).T
        return np.stack([map_coordinates(one.values[..., a], index, order=1, mode="nearest") for a in range(3)], -1)

    p = inside(5)
    between = p + sampled(field.inner, p)
    assert field.forward(p) == pytest.approx(between + sampled(field.background, between), abs=1e-4)


def test_a_needle_is_taken_back_to_rest_and_carried_forth_again():
    field = ss.CarriedField(smooth(6, 3.0), smooth(7, 15.0))
    axis = inside(8, 4)
    assert field.background.forward(field.at_rest(axis)) == pytest.approx(axis, abs=1e-3)


def test_errors_are_those_of_the_parts_over_the_whole():
    known = ss.GridField(GRID, np.full((*GRID.shape, 3), 1.0, np.float32), error_estimate=0.1)
    larger = ss.GridField(GRID, np.full((*GRID.shape, 3), 3.0, np.float32), error_estimate=0.02)
    assert ss.CarriedField(known, larger).error_estimate == pytest.approx((0.1 * 1 + 0.02 * 3) / 4)
    unknown = ss.GridField(GRID, np.zeros((*GRID.shape, 3), np.float32))
    assert ss.CarriedField(known, unknown).error_estimate == pytest.approx(0.1)
    assert ss.CarriedField(unknown, unknown).error_estimate is None


def test_pictures_and_files_take_it(tmp_path):
    field = ss.CarriedField(smooth(9, 3.0), smooth(10, 12.0))
    field.save(tmp_path / "u.npz")
    assert np.load(tmp_path / "u.npz")["displacement"] == pytest.approx(field.on_grid())
    assert field.smallest_jacobian() > 0


def test_what_is_no_field_is_refused():
    with pytest.raises(ValueError, match="background = 3 is not a Field; give one"):
        ss.CarriedField(smooth(1, 1.0), 3)

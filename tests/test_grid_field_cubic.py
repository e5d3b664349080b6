"""A field known at nodes, cubic between them, and taken to other lattices."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.sparse.linalg import spsolve

import sonospline as ss
from builds import needs_core
from sonospline import _core
from sonospline._core import cubic_axis

RANDOM = np.random.default_rng(5)


@pytest.fixture(params=[(9, 7, 11), (5, 4, 6), (3, 12, 2)], ids=str)
def lattice(request, a_rotation):
    return ss.Grid(shape=request.param, spacing=(1.0, 1.5, 0.8), origin=(12, -30, 5), direction=a_rotation)


@pytest.fixture
def field(lattice):
    values = 0.05 * np.random.default_rng(0).standard_normal((*lattice.shape, 3))
    return ss.GridField(lattice, values, order=3)


def inside(grid, count=300):
    return grid.world(np.random.default_rng(1).random((count, 3)) * grid.extent)


def by_scipy(lattice, values, points):
    axes = [np.arange(n) * h for n, h in zip(lattice.shape, lattice.spacing, strict=True)]
    return RegularGridInterpolator(axes, values, method="cubic", solver=spsolve)(lattice.local(points))


def test_it_interpolates_as_scipys_not_a_knot_spline_does(backend, field, lattice):
    if min(lattice.shape) < 4:
        pytest.skip("SciPy's cubic needs four nodes along each axis")
    expected = by_scipy(lattice, field.values, inside(lattice))
    np.testing.assert_allclose(field.displacement(inside(lattice)), expected, rtol=0, atol=3e-6)


def test_it_meets_the_nodes(backend, field, lattice):
    found = field.displacement(lattice.points).reshape(*lattice.shape, 3)
    np.testing.assert_allclose(found, field.values, rtol=0, atol=1e-6)


def test_beyond_the_lattice_the_nearest_value_holds(backend, field, lattice):
    beyond = lattice.world(lattice.extent * [[-0.3, 0.4, 0.5], [1.2, 1.4, 0.5]])
    nearest = lattice.world(lattice.extent * [[0.0, 0.4, 0.5], [1.0, 1.0, 0.5]])
    np.testing.assert_allclose(field.displacement(beyond), field.displacement(nearest), atol=1e-7)


def test_the_jacobian_is_that_of_the_field(backend, field, lattice):
    points, h = lattice.world((0.05 + 0.9 * RANDOM.random((50, 3))) * lattice.extent), 1e-2
    differences = [(field.forward(points + h * e) - field.forward(points - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(field.jacobian(points), np.stack(differences, axis=-1), rtol=0, atol=2e-3)


def test_a_cubic_field_is_exact_with_its_jacobian(backend):
    lattice = ss.Grid(shape=(6, 7, 5), spacing=(0.2, 0.15, 0.3))
    x, y, z = lattice.points.T
    values = np.stack([x**3 - y * z, 0.5 * x * y**2 + z**3, x * y * z], axis=1).reshape(*lattice.shape, 3)
    field = ss.GridField(lattice, values, order=3)
    x, y, z = inside(lattice, 50).T
    expected = np.stack([x**3 - y * z, 0.5 * x * y**2 + z**3, x * y * z], axis=1)
    np.testing.assert_allclose(field.displacement(inside(lattice, 50)), expected, rtol=0, atol=2e-6)
    slopes = field.jacobian(inside(lattice, 50)) - np.eye(3)
    np.testing.assert_allclose(slopes[:, 0], np.stack([3 * x**2, -z, -y], axis=1), rtol=0, atol=3e-5)


def test_the_inverse_undoes_the_forward_map(backend, lattice):
    smooth = 0.05 * np.sin(lattice.points / 3).reshape(*lattice.shape, 3)
    field = ss.GridField(lattice, smooth, order=3)
    points = inside(lattice)
    np.testing.assert_allclose(field.inverse(field.forward(points)), points, rtol=0, atol=5e-6)


@pytest.mark.parametrize("shape", [(13, 9, 20), (30, 30, 30), (5, 5, 5)])
def test_another_lattice_of_the_same_axes_gets_what_its_nodes_would(backend, field, lattice, shape):
    box = lattice.extent
    display = ss.Grid(
        shape=shape,
        spacing=tuple(0.9 * box / (np.array(shape) - 1)),
        origin=lattice.world(0.07 * box[None])[0],
        direction=lattice.direction,
    )
    there = ss.GridField(display, field.values, lattice=lattice, order=3)
    expected = field.displacement(display.points).reshape(*shape, 3)
    np.testing.assert_allclose(there.on_grid(), expected, rtol=0, atol=2e-6)


def test_a_lattice_of_other_axes_is_sampled(backend, field, lattice):
    display = ss.Grid(shape=(4, 5, 6), spacing=0.5, origin=lattice.world(0.3 * lattice.extent[None])[0])
    there = ss.GridField(display, field.values, lattice=lattice, order=3)
    expected = field.displacement(display.points).reshape(4, 5, 6, 3)
    np.testing.assert_allclose(there.on_grid(), expected, rtol=0, atol=1e-6)


@needs_core
def test_both_backends_do_alike(monkeypatch, field, lattice):
    found = []
    for backend in (_core.native, _core.twin):
        monkeypatch.setattr(_core, "active", backend)
        found.append((field.displacement(inside(lattice)), field.jacobian(inside(lattice))))
    for ours, theirs in zip(*found, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6)


def test_cubics_are_nearer_to_a_smooth_field_than_lines():
    fine, coarse = ss.Grid.unit_cube(41), ss.Grid.unit_cube(11)
    values = np.sin(4 * coarse.points).reshape(*coarse.shape, 3)
    errors = [
        np.abs(
            ss.GridField(fine, values, lattice=coarse, order=order).on_grid().reshape(-1, 3) - np.sin(4 * fine.points)
        ).max()
        for order in (1, 3)
    ]
    assert errors[1] < 0.1 * errors[0]


def test_a_filter_of_many_nodes_is_a_band():
    matrix = cubic_axis.filter_matrix(100)
    assert (matrix != 0).sum(axis=1).max() < 40


def test_another_order_is_refused(lattice):
    with pytest.raises(ValueError, match=r"order = 2 is not known; give 1 \(linear\) or 3 \(cubic\)"):
        ss.GridField(lattice, np.zeros((*lattice.shape, 3)), order=2)


def test_a_few_points_are_summed_one_by_one_to_the_same(a_tilted_grid, rng):
    values = rng.standard_normal((*a_tilted_grid.shape, 3)).astype(np.float32)
    points = a_tilted_grid.world(rng.uniform(-0.1, 1.1, (3, 3)) * a_tilted_grid.extent)
    field = ss.GridField(a_tilted_grid, values, order=3)
    few = field.displacement(points)
    assert "_sampled" not in field.__dict__
    many = field.displacement(np.concatenate([points, points]))
    assert few == pytest.approx(many[:3], abs=2e-5)

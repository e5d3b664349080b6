"""A field known at nodes: linear between them, and inverted there."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

import sonospline as ss
from builds import needs_core
from sonospline import _core

TILT = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
RAMP = np.array([[0.1, 0.02, 0.0], [0.03, -0.05, 0.01], [0.0, 0.04, 0.08]])


@pytest.fixture
def tilted_grid():
    return ss.Grid(shape=(9, 7, 11), spacing=(1.0, 1.5, 0.8), origin=(12, -30, 5), direction=TILT)


@pytest.fixture
def random_field(tilted_grid):
    values = 0.05 * np.random.default_rng(0).standard_normal((*tilted_grid.shape, 3))
    return ss.GridField(tilted_grid, values)


@pytest.fixture
def affine_field(tilted_grid):
    return ss.GridField(tilted_grid, ((tilted_grid.points - 3) @ RAMP.T).reshape(*tilted_grid.shape, 3))


@pytest.fixture(scope="module")
def an_insertion_field():
    insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(53)))
    return insertion.advance(ss.Needle((0, 0.45, 0.5), (0.6, 0.5, 0.55)))


def inside(grid, count=500, seed=1):
    return grid.world(np.random.default_rng(seed).random((count, 3)) * grid.extent)


def test_it_interpolates_as_scipy_does(backend, tilted_grid, random_field):
    points = inside(tilted_grid)
    index = (tilted_grid.local(points) / tilted_grid.spacing).T
    expected = np.stack([map_coordinates(random_field.values[..., a], index, order=1) for a in range(3)], axis=1)
    assert np.allclose(random_field.displacement(points), expected, atol=1e-7)


def test_it_meets_the_nodes(backend, tilted_grid, random_field):
    nodes = tilted_grid.points
    assert np.allclose(random_field.displacement(nodes), random_field.values.reshape(-1, 3), atol=1e-7)
    assert random_field.on_grid("direct") is random_field.values


def test_beyond_the_grid_the_nearest_value_holds(backend, tilted_grid, random_field):
    corner = tilted_grid.node([[8, 6, 10]])
    beyond = tilted_grid.world([[100.0, 100, 100]])
    assert np.allclose(random_field.displacement(beyond), random_field.displacement(corner))


def test_an_affine_field_and_its_jacobian_are_exact(backend, tilted_grid, affine_field):
    points = tilted_grid.world((0.1 + 0.8 * np.random.default_rng(1).random((200, 3))) * tilted_grid.extent)
    assert np.allclose(affine_field.displacement(points), (points - 3) @ RAMP.T, atol=1e-5)
    assert np.allclose(affine_field.jacobian(points), np.eye(3) + RAMP, atol=1e-5)


def test_the_inverse_undoes_the_forward_map(backend, an_insertion_field):
    sampled = ss.GridField.of(an_insertion_field)
    points = inside(sampled.grid)
    back, report = sampled.inverse(sampled.forward(points), return_report=True)
    assert report.converged.all()
    assert report.residual < 1e-6
    assert 1 < report.iterations < 40
    assert np.abs(back - points).max() < 2e-6


def test_a_point_without_an_inverse_is_nan_and_counted(backend, tilted_grid, caplog):
    """Where the field is steeper than the identity the iteration does not contract."""
    centre = tilted_grid.world(tilted_grid.extent / 2)
    steep = ss.GridField(tilted_grid, (1.5 * (tilted_grid.points - centre)).reshape(*tilted_grid.shape, 3))
    points = inside(tilted_grid, 20)
    found, report = steep.inverse(points, max_iterations=10, return_report=True)
    assert not report.converged.all()
    assert np.array_equal(np.isnan(found).all(axis=1), ~report.converged)
    assert "did not converge" in caplog.text


@needs_core
def test_both_backends_sample_and_invert_alike(tilted_grid, random_field):
    values = np.ascontiguousarray(random_field.values, dtype=np.float32)
    points = np.random.default_rng(2).random((3000, 3)) * tilted_grid.extent * 1.2 - 0.5
    both = [b.sample_lattice(values, tilted_grid.spacing, points) for b in (_core.native, _core.twin)]
    assert np.allclose(*both, atol=1e-7)
    native, twin = (b.invert_lattice(values, tilted_grid.spacing, points, 1e-6, 50) for b in (_core.native, _core.twin))
    assert np.allclose(native[0], twin[0], atol=1e-6)
    assert (native[1] > 0).all()


def test_the_error_of_interpolation_is_what_it_is_said_to_be(an_insertion_field):
    """About 4e-4 of the cube side at most, next to landmarks; 2e-5 root mean square."""
    sampled = ss.GridField.of(an_insertion_field)
    largest, rms = sampled.interpolation_error(an_insertion_field)
    assert largest < 6e-4
    assert rms < 3e-5
    finer = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25))).advance(ss.Needle((0, 0.45, 0.5), (0.6, 0.5, 0.55)))
    assert ss.GridField.of(finer).interpolation_error(finer)[1] > rms


def test_an_image_plane_of_512_by_512_points_is_inverted(an_insertion_field):
    sampled = ss.GridField.of(an_insertion_field)
    axis = np.linspace(0.05, 0.95, 512)
    plane = np.stack([*np.meshgrid(axis, axis, indexing="ij"), np.full((512, 512), 0.5)], axis=-1).reshape(-1, 3)
    source, report = sampled.inverse(plane, tolerance=1e-5, return_report=True)
    assert report.converged.all()
    exact = an_insertion_field.inverse(plane[::997])
    assert np.abs(source[::997] - exact).max() < 6e-4


def test_values_of_another_shape_are_refused(tilted_grid):
    with pytest.raises(ValueError, match=r"values has shape \(3, 3\); give \(9, 7, 11, 3\)"):
        ss.GridField(tilted_grid, np.zeros((3, 3)))


def test_a_field_without_a_grid_cannot_be_sampled():
    points = np.random.default_rng(0).random((10, 3))
    with pytest.raises(ValueError, match=r"field.grid = None"):
        ss.GridField.of(ss.PolyharmonicSpline.fit(points, points))

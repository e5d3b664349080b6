"""Fields: on the grid and off it, forward, backward, and their derivatives."""

import logging

import numpy as np
import pytest

import sonospline as ss

KERNELS = [ss.Biharmonic(), ss.Triharmonic()]


def linear_field(matrix, grid=None):
    """The field u(x) = matrix x, exactly: no landmark carries any weight."""
    return ss.KernelField(
        kernel=ss.Biharmonic(),
        centres=np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]),
        weights=np.zeros((2, 3)),
        affine=np.vstack([np.zeros(3), np.transpose(matrix)]),
        reference=np.zeros(3),
        grid=grid,
    )


def central_difference(field, points, step):
    """(m, 3, 3) d forward_a / d x_b."""
    columns = [
        (field.forward(points + step * axis) - field.forward(points - step * axis)) / (2 * step) for axis in np.eye(3)
    ]
    return np.stack(columns, axis=2)


def away_from(centres, points, distance):
    """Those of the points that keep their distance from every centre, where U = r has kinks."""
    gap = np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1)
    return points[gap > distance]


@pytest.fixture
def a_composed_field(unit_tissue):
    insertion = ss.Insertion(unit_tissue, ss.NeedleTissueModel.paper_incremental(), accumulation="incremental")
    *_, field = insertion.run((0, 0.413, 0.578), (0.617, 0.531, 0.469), steps=4)
    return field


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("side", [1.0, 100.0])
def test_jacobian_is_the_central_difference(random_landmarks, random_values, random_places, kernel, side):
    field = ss.PolyharmonicSpline.fit(side * random_landmarks, side * random_values, kernel=kernel)
    places = away_from(side * random_landmarks, side * random_places, 0.02 * side)
    assert len(places) > 100
    np.testing.assert_allclose(
        field.jacobian(places), central_difference(field, places, 1e-5 * side), rtol=0, atol=1e-5
    )


@pytest.mark.usefixtures("backend")
def test_rows_of_the_jacobian_are_components_of_the_displacement():
    field = linear_field([[0, 0.3, 0], [0, 0, 0], [0, 0, 0.1]])
    np.testing.assert_allclose(field.jacobian([[0.2, 0.4, 0.6]]), [[[1, 0.3, 0], [0, 1, 0], [0, 0, 1.1]]], atol=1e-15)


def test_slope_at_a_landmark_is_the_mean_of_those_around(a_deformed_field):
    centre = a_deformed_field.centres[-1:]
    around = centre + 1e-7 * np.vstack([np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(
        a_deformed_field.jacobian(centre)[0], a_deformed_field.jacobian(around).mean(axis=0), atol=1e-5
    )


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("side", [1.0, 100.0])
def test_inverse_undoes_forward(rng, side):
    grid = ss.Grid(shape=(13, 13, 13), spacing=side / 12)
    field = ss.Insertion(ss.Tissue(grid)).advance(
        ss.Needle((0, 0.413 * side, 0.578 * side), (0.617 * side, 0.531 * side, 0.469 * side))
    )
    places = side * rng.random((300, 3))
    assert np.abs(field.displacement(places)).max() > 0.005 * side
    back, report = field.inverse(field.forward(places), return_report=True)
    np.testing.assert_allclose(back, places, rtol=0, atol=1e-6 * side)
    assert report.converged.all()
    assert 0 < report.residual <= 1e-9 * side
    assert 2 <= report.iterations < 100
    np.testing.assert_allclose(field.forward(field.inverse(places)), places, rtol=0, atol=2e-9 * side)


def test_inverse_of_a_linear_field_by_hand():
    field = linear_field(np.diag([0.5, 0.0, -0.5]))
    np.testing.assert_allclose(field.inverse([[3.0, 2.0, 1.0]]), [[2.0, 2.0, 2.0]], atol=1e-8)


@pytest.mark.parametrize("slope", [1.5, -2.5])
def test_point_that_cannot_converge_is_nan_and_reported(slope, caplog):
    """With |grad u| > 1 the iteration runs away from every point but the fixed one."""
    field = linear_field(slope * np.eye(3))
    with caplog.at_level(logging.WARNING, logger="sonospline"):
        x, report = field.inverse([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]], return_report=True)
    assert np.isnan(x[0]).all()
    assert x[1].tolist() == [0, 0, 0]
    assert report.converged.tolist() == [False, True]
    assert report.residual == 0
    assert "1 of 2 points did not converge" in caplog.text


def test_point_that_runs_out_of_iterations_is_nan(a_deformed_field, caplog):
    # Near the shaft, where the tissue moves most.
    x, report = a_deformed_field.inverse([[0.3, 0.48, 0.53]], max_iterations=1, return_report=True)
    assert np.isnan(x).all()
    assert report.iterations == 1
    assert not report.converged.any()
    assert "1 of 1 points" in caplog.text


def test_tolerance_is_met_and_not_overdone(a_deformed_field):
    places = a_deformed_field.grid.points
    (_, loose), (_, tight) = (a_deformed_field.inverse(places, tolerance=t, return_report=True) for t in (1e-3, 1e-12))
    assert tight.residual <= 1e-12 < loose.residual <= 1e-3
    assert loose.iterations < tight.iterations


def test_inverse_of_no_points_is_no_points(a_deformed_field):
    x, report = a_deformed_field.inverse(np.empty((0, 3)), return_report=True)
    assert x.shape == (0, 3)
    assert report.residual == 0


GRIDS = {
    "cube": {"shape": (9, 9, 9), "spacing": 0.125},
    "anisotropic": {"shape": (5, 11, 8), "spacing": (0.3, 0.1, 0.17)},
    "offset": {"shape": (6, 7, 8), "spacing": 2.0, "origin": (-40, 55, 300)},
    "thin": {"shape": (2, 70, 3), "spacing": (1.0, 0.02, 0.5)},
}


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("rotated", [False, True], ids=["straight", "rotated"])
@pytest.mark.parametrize("where", GRIDS.values(), ids=GRIDS.keys())
def test_on_grid_is_the_displacement_at_the_nodes(where, rotated, kernel, a_rotation, rng):
    grid = ss.Grid(**where, direction=a_rotation if rotated else np.eye(3))
    points = grid.world(rng.random((40, 3)) * grid.extent)
    # A strong affine part, so that a mistake in its change of frame is seen.
    values = 0.02 * grid.side * rng.standard_normal((40, 3)) + (points - grid.origin) @ (0.1 * a_rotation) + 1
    field = ss.PolyharmonicSpline.fit(points, values, kernel=kernel, grid=grid)
    expected = field.displacement(grid.points).reshape(*grid.shape, 3)
    size = max(grid.side, np.abs(expected).max())
    np.testing.assert_allclose(field.on_grid("direct"), expected, rtol=0, atol=1e-11 * size)
    fast = field.on_grid("direct32")
    assert fast.dtype == np.float32
    # A millionth for U = r; terms of r^3 sums are far larger than their sum, and each is rounded.
    terms = np.abs(field.weights).sum() * grid.extent.max() ** kernel.homogeneity
    tolerance = 1e-6 * size if kernel.homogeneity == 1 else max(1e-6 * size, 2.0**-23 * terms)
    np.testing.assert_allclose(fast, expected, rtol=0, atol=tolerance)


@pytest.mark.usefixtures("backend")
def test_single_precision_is_a_millionth_of_the_side(a_deformed_field):
    error = np.abs(a_deformed_field.on_grid("direct32") - a_deformed_field.on_grid("direct")).max()
    assert 0 < error < 1e-6


@pytest.mark.usefixtures("backend")
def test_far_from_the_origin_nothing_changes(a_rotation):
    """A scanner's coordinates may be a kilometre off: 1e-10 mm of rounding, not float32's 0.06 mm."""
    shift = np.array([1e6, -2e6, 5e5])
    near = ss.Grid(shape=(9, 8, 7), spacing=(10, 11, 12), direction=a_rotation)
    far = ss.Grid(shape=(9, 8, 7), spacing=(10, 11, 12), direction=a_rotation, origin=shift)
    entry, tip = near.world(np.array([[0, 33.3, 37.7], [51.7, 40.1, 30.3]]))
    here = ss.Insertion(ss.Tissue(near)).advance(ss.Needle(entry, tip))
    there = ss.Insertion(ss.Tissue(far)).advance(ss.Needle(entry + shift, tip + shift))
    np.testing.assert_allclose(there.on_grid("direct"), here.on_grid("direct"), rtol=0, atol=1e-7)
    np.testing.assert_allclose(there.on_grid("direct32"), here.on_grid("direct"), rtol=0, atol=1e-6 * near.side)
    places = near.points[::7] + 1.0
    np.testing.assert_allclose(there.jacobian(places + shift), here.jacobian(places), rtol=0, atol=1e-7)
    np.testing.assert_allclose(
        there.inverse(places + shift, tolerance=1e-6) - shift, here.inverse(places), rtol=0, atol=1e-5
    )


@pytest.mark.parametrize(("slope", "determinant"), [(0.1, 1.331), (-1.0, 0.0), (-2.0, -1.0)])
def test_smallest_jacobian_of_a_linear_field(slope, determinant):
    field = linear_field(slope * np.eye(3), grid=ss.Grid.unit_cube(3))
    assert field.smallest_jacobian() == pytest.approx(determinant, abs=1e-12)


def test_smallest_jacobian_sees_a_fold_and_none_where_there_is_none():
    """One landmark pushed past its neighbour turns the tissue between them inside out."""
    corners = np.indices((3, 3, 3)).reshape(3, -1).T / 2.0
    gentle, violent = np.zeros((2, 27, 3))
    gentle[13], violent[13] = [0.1, 0, 0], [0.9, 0, 0]
    grid = ss.Grid.unit_cube(9)
    assert 0 < ss.PolyharmonicSpline.fit(corners, gentle, grid=grid).smallest_jacobian() < 1
    assert ss.PolyharmonicSpline.fit(corners, violent, grid=grid).smallest_jacobian() < 0


@pytest.mark.parametrize("method", ["on_grid", "smallest_jacobian"])
def test_field_without_a_grid_says_so(random_landmarks, random_values, method):
    field = ss.PolyharmonicSpline.fit(random_landmarks, random_values)
    with pytest.raises(ValueError, match=r"grid = None.*pass grid="):
        getattr(field, method)()


@pytest.mark.parametrize("maker", ["a_deformed_field", "a_composed_field"])
def test_unknown_method_is_refused_by_name(request, maker):
    with pytest.raises(ValueError, match=r"method = 'exact' is not known; choose one of auto, multilevel"):
        request.getfixturevalue(maker).on_grid("exact")


@pytest.mark.parametrize("method", ["displacement", "forward", "inverse", "jacobian"])
@pytest.mark.parametrize("maker", ["a_deformed_field", "a_composed_field"])
def test_bad_points_are_refused_by_name(request, maker, method):
    function = getattr(request.getfixturevalue(maker), method)
    with pytest.raises(ValueError, match=r"points contains NaN or infinity.*nan.*give finite"):
        function([[0.1, 0.2, 0.3], [0.1, np.nan, 0.3]])
    with pytest.raises(ValueError, match=r"points has shape \(2,\); give an \(m, 3\) array"):
        function([0.1, 0.2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, r"tolerance = 0.0 .*above zero"),
        ({"tolerance": np.nan}, r"tolerance = nan .*above zero"),
        ({"max_iterations": 0}, r"max_iterations = 0 is too small; give at least 1"),
        ({"max_iterations": 1.5}, r"max_iterations = 1.5 is not a whole number"),
    ],
)
def test_bad_inverse_options_are_refused_by_name(a_deformed_field, options, message):
    with pytest.raises(ValueError, match=message):
        a_deformed_field.inverse([[0.1, 0.2, 0.3]], **options)


def test_composed_field_applies_its_steps_in_order(a_composed_field, random_places):
    assert len(a_composed_field.steps) == 4
    moved = random_places
    for step in a_composed_field.steps:
        moved = moved + step.displacement(moved)
    np.testing.assert_allclose(a_composed_field.forward(random_places), moved, rtol=0, atol=1e-14)


def test_order_of_the_steps_matters():
    """First a stretch along x, then a shear of y by x: not the other way round."""
    stretch, shear = linear_field(np.diag([1.0, 0, 0])), linear_field([[0, 0, 0], [1.0, 0, 0], [0, 0, 0]])
    grid = ss.Grid.unit_cube(2)
    field = ss.ComposedField((stretch, shear), grid, grid.points)
    np.testing.assert_allclose(field.forward([[1.0, 0, 0]]), [[2.0, 2.0, 0]], atol=1e-14)
    np.testing.assert_allclose(field.jacobian([[0.3, 0.3, 0.3]])[0], [[2, 0, 0], [2, 1, 0], [0, 0, 1]], atol=1e-14)


def test_composed_jacobian_is_the_central_difference(a_composed_field, random_places):
    kinks = np.vstack([step.centres for step in a_composed_field.steps])
    places = away_from(kinks, random_places, 0.01)
    assert len(places) > 100
    np.testing.assert_allclose(
        a_composed_field.jacobian(places), central_difference(a_composed_field, places, 1e-6), rtol=0, atol=1e-5
    )


def test_composed_inverse_undoes_forward(a_composed_field, random_places):
    assert np.abs(a_composed_field.displacement(random_places)).max() > 1e-3
    back = a_composed_field.inverse(a_composed_field.forward(random_places))
    np.testing.assert_allclose(back, random_places, rtol=0, atol=1e-6)


@pytest.mark.parametrize("method", ["direct", "direct32"])
def test_composed_field_on_its_grid_is_its_displacement_there(a_composed_field, method):
    nodes = a_composed_field.grid.points
    np.testing.assert_allclose(
        a_composed_field.on_grid(method).reshape(-1, 3), a_composed_field.displacement(nodes), rtol=0, atol=1e-13
    )
    smallest = np.linalg.det(a_composed_field.jacobian(nodes)).min()
    assert a_composed_field.smallest_jacobian() == pytest.approx(smallest, abs=1e-13)

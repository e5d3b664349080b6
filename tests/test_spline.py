"""The bare spline: what it reproduces, which units it does not care about, what it refuses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonospline as ss

KERNELS = [ss.Biharmonic(), ss.Triharmonic()]
CUBE = np.indices((3, 3, 3)).reshape(3, -1).T / 2.0  # 27 landmarks, 0.5 apart
ANGLES = st.tuples(*[st.floats(-3, 3)] * 3)
SHIFTS = st.tuples(*[st.floats(-50, 50)] * 3)


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("smoothing", [0.0, 0.01])
def test_affine_maps_are_reproduced(random_landmarks, random_places, kernel, smoothing):
    a0, matrix = np.array([0.1, -0.2, 0.3]), np.array([[0.1, 0.2, 0], [-0.3, 0, 0.1], [0, 0.05, -0.2]])
    field = ss.PolyharmonicSpline.fit(
        random_landmarks, a0 + random_landmarks @ matrix, kernel=kernel, smoothing=smoothing
    )
    np.testing.assert_allclose(field.displacement(random_places), a0 + random_places @ matrix, rtol=0, atol=1e-12)
    np.testing.assert_allclose(field.weights, 0, atol=1e-11)


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
def test_landmarks_are_met(random_landmarks, random_values, kernel):
    field = ss.PolyharmonicSpline.fit(random_landmarks, random_values, kernel=kernel)
    np.testing.assert_allclose(field.displacement(random_landmarks), random_values, rtol=0, atol=1e-10)


def test_four_landmarks_suffice():
    corners = np.vstack([np.zeros(3), np.eye(3)])
    field = ss.PolyharmonicSpline.fit(corners, 0.1 * corners[:, [1, 2, 0]])
    np.testing.assert_allclose(field.displacement([[0.2, 0.3, 0.4]]), [[0.03, 0.04, 0.02]], atol=1e-14)


def test_solution_satisfies_the_papers_system(random_landmarks, random_values):
    """Equations (6) and (7) written out: positions on the right, and the side conditions."""
    field = ss.PolyharmonicSpline.fit(random_landmarks, random_values)
    ones = np.column_stack([np.ones(len(random_landmarks)), random_landmarks])
    system = np.zeros((64, 64))
    system[:60, :60] = np.linalg.norm(random_landmarks[:, None] - random_landmarks, axis=2)
    system[:60, 60:], system[60:, :60] = ones, ones.T
    targets = np.vstack([random_landmarks + random_values, np.zeros((4, 3))])
    weights = np.linalg.solve(system, targets)[:60]
    np.testing.assert_allclose(field.weights, weights, rtol=0, atol=1e-10)
    np.testing.assert_allclose(ones.T @ field.weights, 0, atol=1e-11)


def test_paper_epsilon_stands_on_the_diagonal_with_a_plus(rng):
    """Equation (4): the field misses a landmark by -eps w, smoothing s by +s w."""
    values = 0.05 * rng.standard_normal(CUBE.shape)
    plus = ss.PolyharmonicSpline.fit(CUBE, values, paper_epsilon=0.1)
    minus = ss.PolyharmonicSpline.fit(CUBE, values, smoothing=0.1)
    np.testing.assert_allclose(plus.displacement(CUBE) - values, -0.1 * plus.weights, atol=1e-12)
    np.testing.assert_allclose(minus.displacement(CUBE) - values, 0.1 * minus.weights, atol=1e-12)
    # Against singularity and away from it: the weights grow with the one and shrink with the other.
    exact = ss.PolyharmonicSpline.fit(CUBE, values)
    sizes = [np.linalg.norm(field.weights) for field in (minus, exact, plus)]
    assert sizes == sorted(sizes)


@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("unit", [1e3, 1e-3, 25.4, 1e6])
def test_unit_of_length_does_not_matter(random_landmarks, random_values, random_places, kernel, unit):
    """Millimetres, micrometres, metres, inches: the same figures in both precisions."""

    def relative(scale):
        grid = ss.Grid(shape=(5, 6, 7), spacing=(scale / 4, scale / 5, scale / 6))
        field = ss.PolyharmonicSpline.fit(scale * random_landmarks, scale * random_values, kernel=kernel, grid=grid)
        shown = field.displacement(scale * random_places), field.on_grid("direct"), field.on_grid("direct32")
        return [*(u / scale for u in shown), field.jacobian(scale * random_places)]

    ours, theirs = relative(unit), relative(1.0)
    # float32 rounds every term of the sum, and for r^3 the terms are a thousand times the result.
    single = 2e-6 if kernel.homogeneity == 1 else 3e-4
    for got, expected, tolerance in zip(ours, theirs, (1e-11, 1e-11, single, 1e-9), strict=True):
        np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("option", ["smoothing", "paper_epsilon"])
def test_diagonal_is_a_length(rng, option):
    values = 0.05 * rng.standard_normal(CUBE.shape)
    cube = ss.PolyharmonicSpline.fit(CUBE, values, **{option: 0.05})
    block = ss.PolyharmonicSpline.fit(1e3 * CUBE, 1e3 * values, **{option: 50.0})
    np.testing.assert_allclose(block.displacement(300 * CUBE), 1e3 * cube.displacement(0.3 * CUBE), atol=1e-9)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@given(angles=ANGLES, shift=SHIFTS)
def test_rigid_motion_carries_the_field_along(kernel, angles, shift):
    rotation = Rotation.from_rotvec(angles).as_matrix()
    rng = np.random.default_rng(7)
    points, values, places = rng.random((30, 3)), 0.05 * rng.standard_normal((30, 3)), rng.random((20, 3))

    def moved(array):
        return array @ rotation.T + shift

    here = ss.PolyharmonicSpline.fit(points, values, kernel=kernel)
    there = ss.PolyharmonicSpline.fit(moved(points), values @ rotation.T, kernel=kernel)
    np.testing.assert_allclose(
        there.displacement(moved(places)), here.displacement(places) @ rotation.T, rtol=0, atol=1e-10
    )


@given(factors=st.tuples(*[st.floats(-10, 10)] * 2))
def test_field_is_linear_in_the_displacements(factors):
    rng = np.random.default_rng(8)
    points, one, two, places = (rng.random((25, 3)) for _ in range(4))
    spline = ss.PolyharmonicSpline(points)
    a, b = factors
    mixed = spline.solve(a * one + b * two).displacement(places)
    apart = a * spline.solve(one).displacement(places) + b * spline.solve(two).displacement(places)
    np.testing.assert_allclose(mixed, apart, rtol=0, atol=1e-11)


def test_one_factor_serves_many_right_hand_sides(random_landmarks, random_places, rng):
    spline = ss.PolyharmonicSpline(random_landmarks, smoothing=0.01)
    fields = [(values, spline.solve(values)) for values in rng.standard_normal((3, 60, 3))]
    # Looked at only after the last solve: no field may depend on the latest one.
    for values, field in fields:
        fresh = ss.PolyharmonicSpline.fit(random_landmarks, values, smoothing=0.01)
        assert np.array_equal(field.displacement(random_places), fresh.displacement(random_places))


def test_coincident_landmarks_of_one_value_count_once(random_landmarks, random_values, random_places):
    twice = [0, 17, 17]
    field = ss.PolyharmonicSpline.fit(
        np.vstack([random_landmarks, random_landmarks[twice]]),
        np.vstack([random_values, random_values[twice]]),
    )
    once = ss.PolyharmonicSpline.fit(random_landmarks, random_values)
    assert len(field.centres) == len(random_landmarks)
    np.testing.assert_allclose(field.displacement(random_places), once.displacement(random_places), atol=1e-13)


def test_smoothing_settles_a_quarrel_of_coincident_landmarks_half_way():
    points, values = np.vstack([CUBE, CUBE[13]]), np.zeros((28, 3))
    values[13], values[27] = [0.2, 0, 0], [0.1, 0, 0]
    apart = ss.PolyharmonicSpline.fit(points, values, smoothing=1e-6).displacement(CUBE[[13]])
    np.testing.assert_allclose(apart, [[0.15, 0, 0]], atol=1e-5)


def grid_plane():
    return np.column_stack([np.indices((3, 3)).reshape(2, -1).T / 2.0, np.full(9, 0.7)])


def with_value(array, value):
    array = np.array(array, float)
    array[3, 1] = value
    return array


BAD_FITS = {
    "NaN landmark": (with_value(CUBE, np.nan), CUBE, {}, r"points contains NaN.*\[0.0, nan, .*give finite"),
    "infinite landmark": (with_value(CUBE, np.inf), CUBE, {}, r"points contains NaN or inf.*inf.*give finite"),
    "NaN value": (CUBE, with_value(CUBE, np.nan), {}, r"values contains NaN.*nan.*give finite"),
    "infinite value": (CUBE, with_value(CUBE, -np.inf), {}, r"values contains NaN or inf.*-inf.*give finite"),
    "three landmarks": (CUBE[:3], CUBE[:3], {}, r"points has 3 rows.*at least 4"),
    "no landmarks": (np.empty((0, 3)), np.empty((0, 3)), {}, r"points has 0 rows.*at least 4"),
    "one plane": (grid_plane(), grid_plane(), {}, r"points all lie in one plane; add a landmark off"),
    "one line": (np.outer(np.arange(6), [1, 2, 3]), np.zeros((6, 3)), {}, r"points all lie.*; add a landmark"),
    "flat array": (CUBE.ravel(), CUBE, {}, r"points has shape \(81,\); give an \(m, 3\) array"),
    "two columns": (CUBE[:, :2], CUBE, {}, r"points has shape \(27, 2\); give an \(m, 3\) array"),
    "flat values": (CUBE, CUBE[:, 0], {}, r"values has shape \(27,\); give an \(m, 3\) array"),
    "fewer values": (CUBE, CUBE[:20], {}, r"values has 20 rows for 27 points; give one row"),
    "text": ([["a", "b", "c"]], CUBE, {}, r"points = .*'a'.* is not numeric; give numbers"),
    "negative smoothing": (CUBE, CUBE, {"smoothing": -0.1}, r"smoothing = -0.1 .*at or above zero"),
    "NaN smoothing": (CUBE, CUBE, {"smoothing": np.nan}, r"smoothing = nan .*give a finite number"),
    "no smoothing number": (CUBE, CUBE, {"smoothing": "some"}, r"smoothing = 'some' is not a number"),
    "negative epsilon": (CUBE, CUBE, {"paper_epsilon": -1e-9}, r"paper_epsilon = -1e-09 .*at or above zero"),
    "epsilon at its limit": (
        CUBE,
        CUBE,
        {"paper_epsilon": 0.15},
        r"paper_epsilon = 0.15 .*\(limit 0.15,.*use a smaller one, or smoothing",
    ),
    "epsilon above its limit": (
        1e3 * CUBE,
        CUBE,
        {"paper_epsilon": 200.0},
        r"paper_epsilon = 200 .*\(limit 150,.*use a smaller one, or smoothing",
    ),
    "coincident, values differ": (
        np.vstack([CUBE, CUBE[5]]),
        np.vstack([CUBE, CUBE[6]]),
        {},
        r"points 5 and 27 coincide but values differ \(\[0.0, 0.5, 1.0\] and \[0.0, 1.0, 0.0\]\); keep one",
    ),
}


@pytest.mark.parametrize(("points", "values", "options", "message"), BAD_FITS.values(), ids=BAD_FITS.keys())
def test_bad_fit_is_refused_with_name_value_and_remedy(points, values, options, message):
    with pytest.raises(ValueError, match=message):
        ss.PolyharmonicSpline.fit(points, values, **options)


def test_coincident_landmarks_without_values_are_refused():
    with pytest.raises(ValueError, match=r"points 5 and 27 coincide; remove one of them or set smoothing"):
        ss.PolyharmonicSpline(np.vstack([CUBE, CUBE[5]]))


def test_epsilon_just_below_its_limit_is_still_solved(rng):
    values = 0.05 * rng.standard_normal(CUBE.shape)
    field = ss.PolyharmonicSpline.fit(CUBE, values, paper_epsilon=0.149)
    # It bends the field, but is no blow-up yet: that comes at 0.4 of the spacing.
    assert 1e-3 < np.abs(field.displacement(CUBE) - values).max() < 1.0


def test_solve_refuses_values_of_another_length():
    with pytest.raises(ValueError, match=r"values has 26 rows for 27 landmarks; give one row a landmark"):
        ss.PolyharmonicSpline(CUBE).solve(CUBE[:26])


def test_field_survives_reuse_of_the_callers_array(random_landmarks, random_values, random_places):
    spline = ss.PolyharmonicSpline(random_landmarks)
    field = spline.solve(random_values)
    before = field.displacement(random_places)
    random_landmarks += 1.0
    assert np.array_equal(field.displacement(random_places), before)


def test_limit_of_epsilon_does_not_depend_on_the_unit_for_the_triharmonic_kernel():
    """For U = r^3 the diagonal is a length cubed: 1e-3 m^3 is 1e6 mm^3."""
    ss.PolyharmonicSpline(CUBE, kernel=ss.Triharmonic(), paper_epsilon=1e-3)
    ss.PolyharmonicSpline(1e3 * CUBE, kernel=ss.Triharmonic(), paper_epsilon=1e6)


def with_an_outlier(rng, distance):
    points = rng.random((30, 3))
    points[0] *= distance
    return points, rng.normal(size=points.shape)


@pytest.mark.parametrize("kernel", KERNELS, ids=repr)
@pytest.mark.parametrize("distance", [10.0**k for k in range(13)])
def test_landmarks_are_met_or_refused(rng, kernel, distance):
    """However far one is from the others: never a field that quietly misses its landmarks."""
    points, values = with_an_outlier(rng, distance)
    try:
        field = ss.PolyharmonicSpline.fit(points, values, kernel=kernel)
    except ValueError as error:
        assert distance >= 1e3
        assert any(
            remedy in str(error)
            for remedy in ("remove outliers", "remove one of them", "keep one of them", "off that plane")
        )
    else:
        assert np.abs(field.displacement(points) - values).max() < 1e-4


def test_an_outlier_is_refused_with_the_nearest_pair(rng):
    points, values = with_an_outlier(rng, 1e9)
    with pytest.raises(
        ValueError, match=r"points spread over .*e\+08, but points \d+ and \d+ are .* apart: too uneven"
    ):
        ss.PolyharmonicSpline.fit(points, values)


@pytest.mark.parametrize("scale", [1e-150, 1e150, 1e308])
def test_units_beyond_all_measure_are_refused(scale):
    with pytest.raises(
        ValueError, match=r"points spread over .*e[-+]\d+ on either side; give different ones, in a unit"
    ):
        ss.PolyharmonicSpline(scale * CUBE)

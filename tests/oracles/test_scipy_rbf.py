"""The bare spline against SciPy's RBFInterpolator, an independent implementation."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

import sonospline as ss

pytestmark = pytest.mark.usefixtures("backend")


@pytest.mark.parametrize("side", [1.0, 100.0])
@pytest.mark.parametrize("smoothing", [0.0, 1e-3, 1e-1])
def test_biharmonic_is_scipys_linear_kernel(random_landmarks, random_values, random_places, smoothing, side):
    points, values, places = side * random_landmarks, side * random_values, side * random_places
    ours = ss.PolyharmonicSpline.fit(points, values, smoothing=smoothing).displacement(places)
    theirs = RBFInterpolator(points, values, kernel="linear", degree=1, smoothing=smoothing)(places)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10 * side)


@pytest.mark.parametrize("smoothing", [0.0, 1e-3, 1e-1])
def test_triharmonic_is_scipys_cubic_kernel(random_landmarks, random_values, random_places, smoothing):
    ours = ss.PolyharmonicSpline.fit(
        random_landmarks, random_values, kernel=ss.Triharmonic(), smoothing=smoothing
    ).displacement(random_places)
    theirs = RBFInterpolator(random_landmarks, random_values, kernel="cubic", degree=1, smoothing=smoothing)(
        random_places
    )
    # The condition number of the r^3 system of 60 random points is of the order 1e6 (SciPy
    # scales it otherwise), so 1e-16 x 1e6 with room to spare; both sums have |u| below 1.
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_smoothing_moves_the_field_at_all(random_landmarks, random_values):
    """Guards the comparisons above: with 1e-1 the landmarks are visibly missed."""
    field = ss.PolyharmonicSpline.fit(random_landmarks, random_values, smoothing=0.1)
    assert np.abs(field.displacement(random_landmarks) - random_values).max() > 1e-3


def test_paper_epsilon_is_negative_smoothing(random_places, rng):
    """The paper adds eps to U = r, SciPy adds its smoothing to -r: the opposite sign."""
    corners = np.indices((3, 3, 3)).reshape(3, -1).T / 2.0
    values = 0.05 * rng.standard_normal(corners.shape)
    ours = ss.PolyharmonicSpline.fit(corners, values, paper_epsilon=0.05).displacement(random_places)
    theirs = RBFInterpolator(corners, values, kernel="linear", degree=1, smoothing=-0.05)(random_places)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10)
    exact = ss.PolyharmonicSpline.fit(corners, values).displacement(random_places)
    assert np.abs(ours - exact).max() > 1e-3


def test_field_of_an_insertion_is_scipys_interpolant_of_its_constraints(unit_tissue, an_oblique_needle):
    insertion = ss.Insertion(unit_tissue)
    field = insertion.advance(an_oblique_needle)
    interpolant = RBFInterpolator(field.centres, field.displacement(field.centres), kernel="linear", degree=1)
    np.testing.assert_allclose(
        field.on_grid("direct").reshape(-1, 3), interpolant(unit_tissue.grid.points), rtol=0, atol=1e-10
    )
    # The constraints themselves: anchors at rest, nodes beside the shaft dragged by up to f_max.
    anchored = field.displacement(field.centres[: len(insertion.anchors)])
    dragged = field.displacement(field.centres[len(insertion.anchors) :]) @ an_oblique_needle.direction
    assert np.abs(anchored).max() < 1e-12
    assert 0.02 < dragged.max() <= 0.0266 + 1e-12

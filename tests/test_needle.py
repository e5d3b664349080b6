"""The needle's axis, equations (9) to (13)."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonospline as ss

PLACES = st.tuples(*[st.floats(-100, 100)] * 3).map(np.array)


@pytest.fixture
def a_needle():
    """Depth 5 along (3, 4, 0) / 5 from (1, 2, 3)."""
    return ss.Needle(entry=(1, 2, 3), tip=(4, 6, 3))


def test_depth_and_direction_by_hand(a_needle):
    assert a_needle.depth == 5
    np.testing.assert_allclose(a_needle.direction, [0.6, 0.8, 0], atol=1e-15)  # (10)


def test_shaft_points_by_hand(a_needle):
    np.testing.assert_allclose(a_needle.at([0, 0.5, 1]), [[1, 2, 3], [2.5, 4, 3], [4, 6, 3]])  # (9)
    np.testing.assert_allclose(a_needle.at(0.2), [1.6, 2.8, 3])


def test_projection_by_hand(a_needle):
    """Two along and 7 up; behind the entry and beside; beyond the tip on the axis."""
    points = np.array([[2.2, 3.6, 10], [0.4 + 0.8, 1.2 - 0.6, 3], [7, 10, 3]])
    seen = a_needle.project(points)
    np.testing.assert_allclose(seen.along, [2, -1, 10], atol=1e-14)  # (11)
    np.testing.assert_allclose(seen.foot, [[2.2, 3.6, 3], [0.4, 1.2, 3], [7, 10, 3]], atol=1e-14)  # (12)
    np.testing.assert_allclose(seen.distance, [7, 1, 0], atol=1e-14)  # (13)


@given(entry=PLACES, tip=PLACES, point=PLACES)
def test_foot_is_the_nearest_point_of_the_axis(entry, tip, point):
    assume(np.linalg.norm(tip - entry) > 1e-3)
    needle = ss.Needle(entry, tip)
    along, foot, distance = (part[0] for part in needle.project(point[None]))
    assert abs((point - foot) @ needle.direction) < 1e-9
    assert along**2 + distance**2 == pytest.approx(np.sum((point - entry) ** 2), abs=1e-8)
    further = foot + np.array([[-1.0], [1.0], [0.01]]) * needle.direction
    assert (np.linalg.norm(point - further, axis=1) >= distance - 1e-9).all()


@given(angles=st.tuples(*[st.floats(-3, 3)] * 3), shift=PLACES)
def test_projection_does_not_depend_on_the_frame(angles, shift):
    rotation = Rotation.from_rotvec(angles).as_matrix()
    entry, tip, *points = np.random.default_rng(5).uniform(-10, 10, (12, 3))
    here = ss.Needle(entry, tip).project(np.array(points))
    moved = ss.Needle(rotation @ entry + shift, rotation @ tip + shift)
    there = moved.project(points @ rotation.T + shift)
    np.testing.assert_allclose(there.along, here.along, rtol=0, atol=1e-10)
    np.testing.assert_allclose(there.distance, here.distance, rtol=0, atol=1e-10)
    np.testing.assert_allclose(there.foot, here.foot @ rotation.T + shift, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("entry", "tip", "message"),
    [
        ((0, 0, 0), (0, 0, 0), r"tip = \[0.0, 0.0, 0.0\] equals the entry; move the tip"),
        ((1e3, 0, 0), (1e3 + 1e-13, 0, 0), r"tip = .* equals the entry; move the tip"),
        ((0, np.nan, 0), (1, 1, 1), r"entry contains NaN.*nan.*give finite"),
        ((0, 0, 0), (1, np.inf, 1), r"tip contains NaN or infinity.*inf.*give finite"),
        ((0, 0), (1, 1, 1), r"entry = \(0, 0\) has shape \(2,\); give three numbers"),
        ((0, 0, 0), [[1, 1, 1]], r"tip = \[\[1, 1, 1\]\] has shape \(1, 3\); give three numbers"),
        ("here", (1, 1, 1), r"entry = 'here' is not numeric; give numbers"),
    ],
)
def test_bad_needle_is_refused_with_name_value_and_remedy(entry, tip, message):
    with pytest.raises(ValueError, match=message):
        ss.Needle(entry, tip)


def test_needle_is_frozen(a_needle):
    with pytest.raises(AttributeError):
        a_needle.tip = np.zeros(3)


def test_needle_survives_reuse_of_the_callers_array():
    tip = np.array([3.0, 0, 0])
    needle = ss.Needle((0, 0, 0), tip)
    tip[0] = 7.0
    assert needle.depth == 3

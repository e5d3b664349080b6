"""Which nodes carry constraints: anchors and landmarks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonospline as ss
from sonospline.mechanics.interaction import accumulated
from sonospline.mechanics.landmarks import plan_landmarks, select_anchors

STRAIGHT = ss.Needle(entry=(0, 0.5, 0.5), tip=(0.613, 0.5, 0.5))
OBLIQUE = ss.Needle(entry=(0, 0.413, 0.578), tip=(0.617, 0.531, 0.469))


@pytest.fixture
def paper_tissue():
    return ss.Tissue(ss.Grid.unit_cube(25))


def distance_from_axis(points, needle):
    """By the cross product, which the code does not use."""
    return np.linalg.norm(np.cross(points - needle.entry, needle.direction), axis=1)


def index_of(grid, points):
    return np.rint(grid.local(points) / grid.spacing).astype(int)


@pytest.mark.parametrize(("per_side", "count"), [(2, 8), (3, 25), (5, 89), (7, 193), (9, 337)])
def test_anchors_of_a_cube(paper_tissue, per_side, count):
    assert len(select_anchors(paper_tissue, per_side)) == count


@pytest.mark.parametrize("per_side", [25, 1000])
def test_as_many_anchors_as_nodes_are_all_pinned_nodes(paper_tissue, per_side):
    anchors = select_anchors(paper_tissue, per_side)
    pinned = paper_tissue.grid.points[paper_tissue.pinned.ravel()]
    np.testing.assert_allclose(anchors, pinned, rtol=0, atol=1e-12)


@pytest.mark.parametrize("entry_face", ss.FACES)
def test_anchors_are_pinned_nodes_and_reach_every_corner(a_tilted_grid, entry_face):
    tissue = ss.Tissue(a_tilted_grid, entry_face=entry_face)
    anchors = select_anchors(tissue, 3)
    index = index_of(a_tilted_grid, anchors)
    np.testing.assert_allclose(a_tilted_grid.node(index), anchors, atol=1e-9)
    assert tissue.pinned[tuple(index.T)].all()
    assert len(np.unique(index, axis=0)) == len(anchors) == 25
    last = np.array(a_tilted_grid.shape) - 1
    corners = np.argwhere(np.ones((2, 2, 2))) * last
    assert {tuple(c) for c in corners} <= {tuple(i) for i in index}


@pytest.mark.parametrize("needle", [STRAIGHT, OBLIQUE], ids=["straight", "oblique"])
@pytest.mark.parametrize("most", [40, 200, 1000])
def test_plan_keeps_within_its_number_and_off_the_pinned_nodes(paper_tissue, needle, most):
    plan = plan_landmarks(paper_tissue, needle, ss.NeedleTissueModel.paper(), max_landmarks=most)
    assert most / 10 < len(plan.nodes) <= most
    assert not paper_tissue.pinned[tuple(plan.nodes.T)].any()
    np.testing.assert_allclose(paper_tissue.grid.node(plan.nodes), plan.points, atol=1e-15)
    assert len(np.unique(plan.nodes, axis=0)) == len(plan.nodes)
    assert (distance_from_axis(plan.points, needle) <= 0.3873).all()


@pytest.mark.parametrize("most", [1, 2, 3, 5])
def test_plan_of_very_few_landmarks(paper_tissue, most):
    plan = plan_landmarks(paper_tissue, OBLIQUE, ss.NeedleTissueModel.paper(), max_landmarks=most)
    assert 1 <= len(plan.nodes) <= most


def test_plan_without_a_limit_is_every_node_the_needle_can_reach(paper_tissue):
    model = ss.NeedleTissueModel.paper()
    plan = plan_landmarks(paper_tissue, OBLIQUE, model, max_landmarks=10**6)
    points = paper_tissue.grid.points
    ahead = (points - OBLIQUE.entry) @ OBLIQUE.direction >= 0
    reachable = ahead & (distance_from_axis(points, OBLIQUE) <= model.shaft_radius) & ~paper_tissue.pinned.ravel()
    assert sorted(np.ravel_multi_index(tuple(plan.nodes.T), (25, 25, 25))) == np.flatnonzero(reachable).tolist()


@pytest.mark.parametrize("needle", [STRAIGHT, OBLIQUE], ids=["straight", "oblique"])
def test_nodes_next_to_the_axis_are_all_kept(paper_tissue, needle):
    plan = plan_landmarks(paper_tissue, needle, ss.NeedleTissueModel.paper(), max_landmarks=200)
    points = paper_tissue.grid.points
    ahead = (points - needle.entry) @ needle.direction >= 0
    close = ahead & (distance_from_axis(points, needle) <= 0.75 / 24) & ~paper_tissue.pinned.ravel()
    assert close.sum() >= 24
    assert set(np.flatnonzero(close)) <= set(np.ravel_multi_index(tuple(plan.nodes.T), (25, 25, 25)))


def test_too_many_nodes_next_to_the_axis_are_thinned_along_it(paper_tissue):
    """Half of 20 landmarks follow the axis, from its first stretch to its last."""
    plan = plan_landmarks(paper_tissue, STRAIGHT, ss.NeedleTissueModel.paper(), max_landmarks=20)
    on_axis = plan.points[distance_from_axis(plan.points, STRAIGHT) < 1e-9][:, 0]
    assert len(on_axis) >= 10
    assert on_axis.min() == 0
    assert on_axis.max() > 0.9
    assert np.diff(np.sort(on_axis)).max() < 0.2


@pytest.mark.parametrize("needle", [STRAIGHT, OBLIQUE], ids=["straight", "oblique"])
def test_active_landmarks_grow_as_a_prefix(paper_tissue, needle):
    model = ss.NeedleTissueModel.paper()
    plan = plan_landmarks(paper_tissue, needle, model, max_landmarks=200)
    assert (np.diff(plan.history.wakes) >= 0).all()
    counts = []
    # Depths tie with no node, so that rounding decides nothing.
    for depth in np.linspace(0.0131, 0.6131, 12):
        here = ss.Needle(needle.entry, needle.entry + depth * needle.direction)
        displaced = accumulated(plan.points, here, model).any(axis=1)
        counts.append(plan.active_count(depth))
        assert displaced[: counts[-1]].all()
        assert not displaced[counts[-1] :].any()
    assert 0 < counts[0] < counts[5] < counts[-1] < len(plan.nodes)


def test_no_landmark_is_active_before_the_entry(paper_tissue):
    plan = plan_landmarks(paper_tissue, OBLIQUE, ss.NeedleTissueModel.paper(), max_landmarks=200)
    assert plan.active_count(-1e-9) == 0
    assert plan.active_count(np.inf) == len(plan.nodes)


def test_landmark_level_with_the_tip_is_active(paper_tissue):
    """As the shaft's friction is: up to the inserted length, and including it (eq. 14)."""
    plan = plan_landmarks(paper_tissue, STRAIGHT, ss.NeedleTissueModel.paper(), max_landmarks=200)
    beside = distance_from_axis(plan.points, STRAIGHT) > 0.1
    level = plan.history.wakes[beside & (plan.history.wakes > 0)][0]
    assert plan.active_count(level) - plan.active_count(level * (1 - 1e-6)) == (plan.history.wakes == level).sum()


def test_plan_depends_on_the_axis_not_on_the_depth(paper_tissue):
    model = ss.NeedleTissueModel.paper()
    plans = [
        plan_landmarks(paper_tissue, ss.Needle(OBLIQUE.entry, OBLIQUE.at(part)), model, max_landmarks=200)
        for part in (0.1, 1.0)
    ]
    assert np.array_equal(plans[0].nodes, plans[1].nodes)


@given(
    shape=st.tuples(*[st.integers(3, 30)] * 3),
    spacing=st.tuples(*[st.floats(0.5, 3)] * 3),
    ends=st.tuples(*[st.floats(0, 1)] * 6),
    most=st.integers(1, 250),
    entry_face=st.sampled_from(ss.FACES),
)
def test_plan_holds_its_promises_on_any_box(shape, spacing, ends, most, entry_face):
    rotation = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    grid = ss.Grid(shape=shape, spacing=spacing, origin=(-7, 11, 3), direction=rotation)
    tissue = ss.Tissue(grid, entry_face=entry_face)
    entry, tip = grid.world(np.reshape(ends, (2, 3)) * grid.extent)
    if np.linalg.norm(tip - entry) < 1e-3:
        tip = grid.world(0.5 * grid.extent[None])[0] + 0.1
    model = ss.NeedleTissueModel.paper(grid.side)
    plan = plan_landmarks(tissue, ss.Needle(entry, tip), model, max_landmarks=most)
    assert len(plan.nodes) <= most
    assert not tissue.pinned[tuple(plan.nodes.T)].any()
    assert ((plan.nodes >= 0) & (plan.nodes < shape)).all()
    assert np.isfinite(plan.history.wakes).all()
    assert (np.diff(plan.history.wakes) >= 0).all()
    # No limit in sight means every node in reach: a superset of any thinned plan.
    everything = plan_landmarks(tissue, ss.Needle(entry, tip), model, max_landmarks=10**6)
    assert {tuple(n) for n in plan.nodes} <= {tuple(n) for n in everything.nodes}

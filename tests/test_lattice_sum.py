"""The way a field is summed on its grid: chosen by cost, never at the price of the promised accuracy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from sonospline import _core, _memory
from sonospline.fields import lattice_sum

ENTRY, TIP = np.array([[0, 0.45, 0.5], [0.6, 0.5, 0.55]])


@pytest.fixture(scope="module")
def a_fine_field():
    return ss.Insertion(ss.Tissue(ss.Grid.unit_cube(41))).advance(ss.Needle(ENTRY, TIP))


def error(field, method):
    return float(np.abs(field.on_grid(method) - field.on_grid("direct")).max()) / field.grid.side


@pytest.mark.parametrize(("method", "promise"), [("auto", 1e-5), ("multilevel", 1e-5), ("accurate", 1e-6)])
def test_each_method_keeps_its_promise(a_fine_field, method, promise):
    assert a_fine_field.on_grid(method).dtype == np.float32
    assert 0 < error(a_fine_field, method) < promise


@settings(max_examples=30)
@given(
    shape=st.tuples(*[st.integers(2, 40)] * 3),
    stretch=st.tuples(*[st.floats(0.5, 2)] * 3),
    count=st.integers(4, 200),
    roughness=st.floats(0, 0.05),
    seed=st.integers(0, 1000),
)
def test_any_grid_and_any_landmarks_on_its_nodes(shape, stretch, count, roughness, seed):
    """Smooth and rough displacements, odd and even sizes, long cells: at most 1e-5 of the side."""
    random = np.random.default_rng(seed)
    grid = ss.Grid(shape=shape, spacing=np.divide(stretch, max(shape)))
    nodes = np.unique(random.integers(0, shape, (count, 3)), axis=0)
    if len(nodes) < 4 or np.linalg.matrix_rank(nodes - nodes.mean(axis=0)) < 3:
        return
    points = grid.node(nodes)
    values = 0.02 * np.sin(3 * points[:, ::-1]) + roughness * random.standard_normal(points.shape)
    field = ss.PolyharmonicSpline.fit(points, values, grid=grid)
    side = max(field.length, np.abs(values).max())
    for method, promise in (("auto", 1e-5), ("multilevel", 1e-5), ("accurate", 1e-6)):
        difference = np.abs(field.on_grid(method) - field.on_grid("direct")).max() / side
        # Of the float32 sum that may take its place: it grows with the longest side.
        rounding = 1e-7 * np.abs(field.weights).sum() * grid.extent.max() / side
        assert difference < promise + rounding


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e3, 1e6], ids=["metres", "mm", "micrometres", "nanometres"])
def test_the_unit_of_length_does_not_matter(unit):
    """A 100 mm cube in other units: the same relative error, and float32 never overflows."""
    grid = ss.Grid(shape=(33, 33, 33), spacing=100 * unit / 32, origin=(7 * unit,) * 3)
    needle = ss.Needle(*(100 * unit * np.stack([ENTRY, TIP]) + grid.origin))
    field = ss.Insertion(ss.Tissue(grid)).advance(needle)
    for method in ("auto", "direct32"):
        assert error(field, method) == pytest.approx(UNIT_CUBE_ERRORS(method), rel=0.5)


def UNIT_CUBE_ERRORS(method):  # noqa: N802
    field = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(33))).advance(ss.Needle(ENTRY, TIP))
    return error(field, method)


def test_landmarks_off_the_nodes_are_summed_directly(a_fine_field, monkeypatch):
    points = a_fine_field.centres + 0.3 / 40
    field = ss.PolyharmonicSpline.fit(points, a_fine_field.displacement(a_fine_field.centres), grid=a_fine_field.grid)
    monkeypatch.setattr(lattice_sum, "_plan", lambda *_: pytest.fail("a multilevel sum off the nodes"))
    for method in ("auto", "multilevel", "accurate"):
        assert error(field, method) < 1e-6


@pytest.mark.parametrize("place", [(-1, 0, 0), (0, 0, 9), (4.4, 2, 2)])
def test_nodes_outside_the_grid_or_between_are_none(place):
    assert lattice_sum.node_index(np.array([[1.0, 2, 3]]), (9, 9, 9), (1.0,) * 3).tolist() == [[1, 2, 3]]
    assert lattice_sum.node_index(np.array([[1.0, 2, 3], place]), (9, 9, 9), (1.0,) * 3) is None


def test_rotated_grids_in_the_world_are_summed_the_same():
    rotation = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    grid = ss.Grid(shape=(35, 30, 41), spacing=(2.5, 3.0, 2.0), origin=(40, -300, 77), direction=rotation)
    entry, tip = grid.world(grid.extent * np.stack([ENTRY, TIP]))
    field = ss.Insertion(ss.Tissue(grid)).advance(ss.Needle(entry, tip))
    assert lattice_sum.node_index(grid.local(field.centres), grid.shape, grid.spacing) is not None
    assert error(field, "multilevel") < 1e-5


def test_tiny_grids_step_aside_for_the_direct_sum():
    field = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(4)), anchors=2).advance(ss.Needle(ENTRY, TIP))
    assert np.array_equal(field.on_grid("auto"), field.on_grid("direct32"))
    assert error(field, "multilevel") < 1e-5


def test_a_kernel_without_a_multilevel_sum_is_summed_directly():
    tissue = ss.Tissue(ss.Grid.unit_cube(17))
    field = ss.Insertion(tissue, kernel=ss.Triharmonic()).advance(ss.Needle(ENTRY, TIP))
    assert np.array_equal(field.on_grid("auto"), field.on_grid("direct"))


def test_weights_too_large_for_the_promise_take_a_finer_cut_off():
    small, large = np.full((10, 3), 1e-3), np.full((10, 3), 1.0)
    nodes = np.argwhere(np.ones((3, 3, 3)))[:10] * 4
    chosen = [lattice_sum.choose((31, 31, 31), (1 / 30,) * 3, nodes, w, 1e-5) for w in (small, large)]
    assert chosen[0] is not None
    assert chosen[1] is not None
    bounds = [c.plan.error_per_weight(1) for c in chosen]
    assert bounds[1] < bounds[0]
    assert lattice_sum.choose((31, 31, 31), (1 / 30,) * 3, nodes, 1e4 * large, 1e-5) is None


def test_a_plan_is_made_once_for_a_grid(a_fine_field):
    a_fine_field.on_grid("multilevel")
    made = lattice_sum._plan.cache_info().misses
    a_fine_field.on_grid("multilevel")
    assert lattice_sum._plan.cache_info().misses == made


@pytest.mark.parametrize("method", ["auto", "direct"])
def test_a_grid_too_large_for_memory_is_refused_before_allocation(method, monkeypatch):
    points = np.random.default_rng(0).random((10, 3))
    huge = ss.Grid.unit_cube(20_000)
    field = ss.PolyharmonicSpline.fit(points, points, grid=huge)
    monkeypatch.setattr(_core.active, "MultilevelPlan", lambda *_: pytest.fail("allocated"))
    with pytest.raises(ValueError, match=r"grid = \(20000, 20000, 20000\).* would take [\d,]{15,} bytes.*coarser grid"):
        field.on_grid(method)
    with pytest.raises(ValueError, match=r"positions of its nodes would take [\d,]{15,} bytes"):
        _ = huge.points


def test_memory_is_asked_of_the_system():
    available = _memory.available_bytes()
    assert available is None or available > 10_000_000

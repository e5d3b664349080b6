"""The growing system: appended and dropped landmarks give what a dense solve of the final ones gives."""

import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonospline as ss
from sonospline import _core
from sonospline.models.spline import anchored
from sonospline.models.spline.anchored import Solution

KERNELS = [ss.Biharmonic(), ss.Triharmonic()]


def random_points(count, seed=0):
    return np.random.default_rng(seed).random((count, 3))


def positive_definite(size, seed=0):
    a = np.random.default_rng(seed).standard_normal((size, size + 10))
    return a @ a.T / size


def saddle_point(points, values, kernel, smoothing=0.0):
    """Weights and affine part by the paper's own matrix (6), solved densely."""
    n = len(points)
    system = np.zeros((n + 4, n + 4))
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    system[:n, :n] = distance if isinstance(kernel, ss.Biharmonic) else distance**3
    system[:n, :n] += kernel.sign * smoothing * np.eye(n)
    system[:n, n], system[:n, n + 1 :] = 1, points
    system[n:, :n] = system[:n, n:].T
    return np.linalg.solve(system, np.vstack([values, np.zeros((4, 3))]))[:n]


@given(chunks=st.lists(st.integers(0, 40), min_size=1, max_size=6), first=st.integers(0, 30))
def test_a_factor_grown_in_chunks_solves_as_numpy_does(chunks, first):
    matrix = positive_definite(max(1, sum(chunks)))
    for backend in filter(None, (_core.native, _core.twin)):
        factor = backend.CholeskyFactor()
        for chunk in chunks:
            end = factor.size + chunk
            assert factor.append(np.ascontiguousarray(matrix[factor.size : end, :end]), 1e-14)
        n = factor.size
        right = np.random.default_rng(1).standard_normal((3, n))
        first = min(first, n)
        right[:, :first] = 0
        x = right.copy()
        factor.solve(x, first)
        assert np.allclose(x @ matrix[:n, :n], right, atol=1e-10)


@given(
    size=st.integers(1, 60),
    changed=st.integers(0, 60),
    first=st.integers(0, 20),
    kept=st.integers(0, 60),
    shown=st.integers(1, 60),
)
def test_what_was_solved_before_leaves_no_trace(size, changed, first, kept, shown):
    """A solve that takes up the forward half of the last one gives the bits of one that does not."""
    matrix, random = positive_definite(60), np.random.default_rng(1)
    before, after = random.standard_normal((2, 3, 60))
    before[:, : min(first, size)] = after[:, : min(first, size)] = 0
    after[:, :changed] = before[:, :changed]
    for backend in filter(None, (_core.native, _core.twin)):
        used, fresh = backend.CholeskyFactor(), backend.CholeskyFactor()
        for factor in (used, fresh):
            factor.append(matrix[:size, :size].copy(), 1e-14)
        used.solve(before[:, :size].copy(), min(first, size))
        for factor in (used, fresh):
            factor.truncate(min(kept, size))
            factor.append(np.ascontiguousarray(matrix[factor.size : size, :size]), 1e-14)
        one, other = (after[:, : min(shown, size)].copy() for _ in range(2))
        start = min(first, one.shape[1])
        used.solve(one, start), fresh.solve(other, start)
        assert np.array_equal(one, other)


@pytest.mark.parametrize("isa", _core.native.instruction_sets() if _core.native else [])
def test_every_instruction_set_factors_alike(isa):
    used = _core.native.instruction_set()
    matrix, right = positive_definite(203), np.random.default_rng(1).standard_normal((3, 203))
    try:
        _core.native.use_instruction_set(isa)
        factor = _core.native.CholeskyFactor()
        assert factor.append(np.ascontiguousarray(matrix[:77, :77]), 1e-14)
        assert factor.append(np.ascontiguousarray(matrix[77:]), 1e-14)
        factor.solve(right)
    finally:
        _core.native.use_instruction_set(used)
    assert np.allclose(right, np.linalg.solve(matrix, np.random.default_rng(1).standard_normal((3, 203)).T).T)


def test_a_refused_row_leaves_the_factor_as_it_was(backend):
    matrix = positive_definite(30)
    factor = _core.active.CholeskyFactor()
    factor.append(matrix[:20, :20].copy(), 1e-14)
    twice = np.vstack([matrix[20:25, :20], matrix[3:4, :20]])
    rows = np.hstack([twice, np.zeros((6, 6))])
    rows[:5, 20:25], rows[5, 20:25], rows[5, 25] = matrix[20:25, 20:25], matrix[3, 20:25], matrix[3, 3]
    assert not factor.append(rows, 1e-10)
    assert factor.size == 20
    right = np.ones((3, 20))
    factor.solve(right)
    assert np.allclose(right @ matrix[:20, :20], 1)


@pytest.mark.parametrize("kernel", KERNELS, ids=["r", "r^3"])
@pytest.mark.parametrize("smoothing", [0.0, 1e-2])
def test_appended_landmarks_weigh_what_the_papers_matrix_says(backend, kernel, smoothing):
    points, values = random_points(90), random_points(90, seed=1) - 0.5
    spline = ss.PolyharmonicSpline(points[:30], kernel=kernel, smoothing=smoothing)
    spline.append(points[30:37])
    spline.append(points[37:])
    weights = saddle_point(points, values, kernel, smoothing)
    assert np.allclose(spline.solve(values).weights, weights, rtol=0, atol=1e-9 * np.abs(weights).max())


def test_200_steps_agree_with_a_dense_solve():
    """Weights to 1e-10 of the largest, after 200 appends of two landmarks to 89 anchors."""
    tissue = ss.Tissue(ss.Grid.unit_cube(53))
    anchors = ss.Insertion(tissue).anchors
    inner = np.argwhere(~tissue.pinned)
    landmarks = tissue.grid.node(inner[np.random.default_rng(0).choice(len(inner), 400, replace=False)])
    values = 0.02 * random_points(489, seed=2)
    spline = ss.PolyharmonicSpline(anchors)
    for step in range(200):
        spline.append(landmarks[2 * step : 2 * step + 2])
    dense = saddle_point(np.vstack([anchors, landmarks]), values, ss.Biharmonic())
    assert np.abs(spline.solve(values).weights - dense).max() <= 1e-10 * np.abs(dense).max()


def test_landmarks_dropped_and_appended_again_change_nothing(backend):
    points, values = random_points(60), random_points(60, seed=1)
    spline = ss.PolyharmonicSpline(points[:20])
    spline.append(points[20:])
    whole = spline.solve(values).weights
    spline.truncate(35)
    assert len(spline.points) == 35
    short = ss.PolyharmonicSpline(points[:35]).solve(values[:35]).weights
    assert np.allclose(spline.solve(values[:35]).weights, short, atol=1e-10)
    spline.append(points[35:])
    assert np.allclose(spline.solve(values).weights, whole, atol=1e-10)


@pytest.mark.parametrize("size", [3, 19, 61])
def test_only_appended_landmarks_can_be_dropped(size):
    spline = ss.PolyharmonicSpline(random_points(20))
    spline.append(random_points(40, seed=1))
    with pytest.raises(ValueError, match=f"size = {size} is out of range; give 20 to 60"):
        spline.truncate(size)


@pytest.mark.parametrize("twin", [5, 27], ids=["of the first ones", "of an appended one"])
def test_an_appended_duplicate_is_refused_and_changes_nothing(backend, twin):
    points, values = random_points(30), random_points(30, seed=1)
    spline = ss.PolyharmonicSpline(points[:20])
    spline.append(points[20:])
    before = spline.solve(values).weights
    with pytest.raises(ValueError, match=f"points {twin} and 31 coincide; remove one"):
        spline.append(np.vstack([[2.0, 2, 2], points[twin]]))
    assert len(spline.points) == 30
    assert np.array_equal(spline.solve(values).weights, before)


def test_a_bad_residual_is_said_and_mended(monkeypatch, caplog):
    """The factor is spoilt by hand; solve() must notice, say so, and factor at once."""
    points, values = random_points(40), random_points(40, seed=1)
    spline = ss.PolyharmonicSpline(points[:20])
    spline.append(points[20:])
    right = spline.solve(values).weights
    whole, spoilt = anchored.AnchoredSystem.solve, []

    def solve(self, at_corners, at_others):
        solution = whole(self, at_corners, at_others)
        if spoilt:
            return solution
        spoilt.append(True)
        return Solution(solution.base_weights, solution.weights * 1.001, solution.affine)

    monkeypatch.setattr(anchored.AnchoredSystem, "solve", solve)
    with caplog.at_level(logging.WARNING):
        assert np.allclose(spline.solve(values).weights, right, atol=1e-9)
    assert "factoring 40 landmarks at once" in caplog.text


def test_the_factor_of_an_insertion_follows_the_needle_in_and_out():
    """In, out, on another axis and back: always the weights of a spline made from scratch."""
    insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25)))
    ways = [((0, 0.5, 0.5), (1, 0, 0)), ((0, 0.4, 0.6), (0.9, 0.1, -0.2))]
    for way, depth in [(0, 0.2), (0, 0.5), (0, 0.31), (1, 0.4), (1, 0.45), (0, 0.6), (0, 0.05)]:
        entry, direction = map(np.array, ways[way])
        field = insertion.advance(ss.Needle(entry, entry + depth * direction))
        values = np.zeros_like(field.centres)
        values[89:] = insertion.plan.history.at(insertion.needle.depth, insertion.landmark_count)
        scratch = ss.PolyharmonicSpline(field.centres).solve(values)
        assert insertion.landmark_count == len(field.centres) - 89 > 0
        assert np.allclose(field.weights, scratch.weights, atol=1e-10 * np.abs(scratch.weights).max())

"""The multilevel sum is many times faster than the direct float32 sum, to 1e-5 of the cube side.

Prints, for several grids and numbers of landmarks, times (medians), the ratio to the direct
sum taken in the same minute, and the largest error against the float64 direct sum. Half
of the landmarks lie on five faces of the cube and half in a tube around the needle's axis.

    python benchmarks/multilevel_beats_direct.py [--threads 2] [--largest 216]
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from sonospline import PolyharmonicSpline
from sonospline._core import native

CASES = [
    (25, 300),
    *[(53, n) for n in (100, 300, 1000, 3000)],
    (100, 300),
    *[(m, 1000) for m in (100, 216, 464)],
]
DIRECT_PAIRS = 2e9  # the direct sum is timed on at most so many pairs, then scaled
SETTINGS = {"default": {}, "accurate": {"tolerance": 2e-6, "orders": (8, 8, 8)}}


def fitted(nodes: int, n: int, seed: int = 0):
    """Landmarks (lattice index), weights and affine part of a needle-like field in the unit cube."""
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, nodes, (n // 2, 3))
    axis, side = np.array([(1, 0), (1, 1), (2, 0), (2, 1), (0, 1)])[rng.integers(0, 5, n // 2)].T
    faces[np.arange(n // 2), axis] = side * (nodes - 1)
    faces = np.unique(faces, axis=0)
    around = np.clip(rng.normal(0.5, 0.06, (4 * n, 2)), 0.1, 0.9)
    tube = np.column_stack([rng.uniform(0.02, 0.6, 4 * n), around])
    tube = np.unique(np.rint(tube * (nodes - 1)).astype(np.int64), axis=0)
    index = np.concatenate([faces, rng.permutation(tube)[: n - len(faces)]])
    points = index / (nodes - 1)
    off_axis = points[:, 1:] - 0.5
    decay = np.exp(-0.5 * (off_axis**2).sum(axis=1) / 0.1291**2)
    push = np.column_stack([0.0227 * decay, -0.1 * off_axis * decay[:, None]])
    push[: len(faces)] = 0
    field = PolyharmonicSpline.fit(points, push)
    affine = np.vstack([field.affine[0] - field.reference @ field.affine[1:], field.affine[1:]])
    return index, np.ascontiguousarray(field.weights), affine


def median_ms(function, budget_s: float = 1.0) -> float:
    times: list[float] = []
    while len(times) < 3 or (sum(times) < budget_s and len(times) < 200):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def largest_error(result, index, weights, affine, nodes: int, sample: int = 100_000) -> float:
    """Against the float64 sum, on all nodes or on a random sample of them."""
    rng = np.random.default_rng(1)
    count = nodes**3
    chosen = np.arange(count) if count <= 1.1e6 else rng.integers(0, count, sample)
    points = np.stack(np.unravel_index(chosen, (nodes,) * 3), axis=1) / (nodes - 1)
    exact = native.sum_at_points_f64(0, points, index / (nodes - 1), weights, affine)
    return float(np.abs(result.reshape(-1, 3)[chosen] - exact).max())


def direct_ms(nodes: int, index, weights, affine) -> float:
    """Direct float32 sum, on as many planes as are needed for a fair time."""
    planes = int(np.clip(DIRECT_PAIRS / (len(index) * nodes**2), 1, nodes))
    spacing = (1 / (nodes - 1),) * 3
    shape = (planes, nodes, nodes)
    points = index / (nodes - 1)
    time_ms = median_ms(lambda: native.sum_on_lattice_f32(0, shape, spacing, points, weights, affine))
    return time_ms * nodes / planes


def measure(nodes: int, n: int, name: str, problem, direct: float) -> str:
    """One line of the table: a plan made, its depth chosen, its result timed and checked."""
    index, weights, affine = problem
    start = time.perf_counter()
    plan = native.MultilevelPlan((nodes,) * 3, (1 / (nodes - 1),) * 3, **SETTINGS[name])
    depth = plan.depth(n)
    made = 1e3 * (time.perf_counter() - start)
    line = f"{nodes:4d}^3 {n:5d} {name:>10s} {depth:6d} {made:8.1f}"
    if depth == 0:
        return f"{line}   the direct sum is faster"
    result = plan.evaluate(index, weights, affine, depth)
    mine = median_ms(lambda: plan.evaluate(index, weights, affine, depth, result))
    error = largest_error(result, index, weights, affine, nodes)
    slack = plan.error_per_weight(depth) * np.abs(weights).sum(axis=0).max() / error
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return (
        f"{line} {mine:8.2f} {1e6 * mine / nodes**3:8.1f}"
        f" {direct:10.1f} {direct / mine:6.1f} {error:8.1e} {slack:12.0f} {peak:8.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=native.thread_count())
    parser.add_argument("--largest", type=int, default=464)
    arguments = parser.parse_args()
    native.set_thread_count(arguments.threads)
    print(f"{native.instruction_set()}, {arguments.threads} threads")
    print("nodes     n    setting  depth  plan ms", end="       ")
    print("ms  ns/node  direct ms  ratio    error  bound/error  peak GB")
    for nodes, n in CASES:
        if nodes > arguments.largest:
            continue
        problem = fitted(nodes, n)
        direct = direct_ms(nodes, *problem)
        for name in SETTINGS if nodes <= 216 else ("default",):
            print(measure(nodes, n, name, problem, direct), flush=True)


if __name__ == "__main__":
    main()

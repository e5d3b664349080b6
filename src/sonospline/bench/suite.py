"""The sections of the race. Each returns plain rows, ready for JSON."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from ..geometry.needle import Needle, equal_steps
from ..geometry.tissue import Tissue
from ..mechanics.landmarks import select_anchors
from ..models.spline.insertion import Insertion
from ..models.spline.spline import PolyharmonicSpline
from . import machine
from .contenders import OURS, PEERS, dense_fit
from .problem import Problem
from .timing import REST_S, Times, elapsed_ms, once, race, several, steps_ms

Row = dict[str, Any]
Tell = Callable[[str], None]
_LARGE = 500_000
_STEPS = 20
"""Of an insertion: a quarter of them, the last, are timed."""
_FITTED_BEFORE = "as on the smaller grids"
MULTILEVEL, DIRECT32 = OURS[0], OURS[2]


def all_nodes(sides: Sequence[int], counts: Sequence[int], rounds: int, tell: Tell) -> list[Row]:
    """Evaluation of all nodes, and fit plus evaluation: everybody, every size."""
    rows = []
    for side in sides:
        for count in counts:
            tell(f"all nodes: {side}^3, n = {count}")
            rows += _all_nodes(Problem.make(side, count), rounds)
    return rows


def _all_nodes(problem: Problem, rounds: int) -> list[Row]:
    large = problem.grid.node_count > _LARGE
    rounds = min(rounds, 3) if large else rounds
    everybody = OURS + PEERS
    reasons = {c.name: reason for c in everybody if (reason := c.unable(problem))}
    able = [c for c in everybody if c.name not in reasons]
    fitted = {c.name: c.fit(problem) for c in able}
    exact = next(c for c in able if c.name == "sonospline direct")
    truth = exact.values(exact.evaluate(problem, fitted[exact.name]))
    evaluation = race({c.name: partial(c.evaluate, problem, fitted[c.name]) for c in able}, rounds)
    # A fit does not depend on the grid: on large ones it is not timed again.
    unfit = {c.name: c.unable_to_fit(problem) or (_FITTED_BEFORE if large else None) for c in able}
    fitting = [c for c in able if unfit[c.name] is None]
    fits = {c.name: Times(tuple(several(partial(c.fit, problem)) for _ in range(3))) for c in fitting}
    rows = []
    for contender in everybody:
        row: Row = {"nodes": problem.grid.node_count, "landmarks": problem.count, "contender": contender.name}
        if contender.name in reasons:
            rows.append(row | {"left_out": reasons[contender.name]})
            continue
        times = evaluation[contender.name]
        error = np.abs(contender.values(contender.evaluate(problem, fitted[contender.name])) - truth).max()
        row |= {
            "evaluate": times.as_dict(),
            "error": float(error),
            "ratio_to_multilevel": times.ratio_to(evaluation[MULTILEVEL.name]),
        }
        if contender.name in fits:
            row["fit"] = fits[contender.name].as_dict()
            row["fit_and_evaluate_ms"] = fits[contender.name].median + times.median
        else:
            row["fit_left_out"] = unfit[contender.name]
        rows.append(row)
    return rows


def _insertion_with(tissue: Tissue, needle: Needle, count: int) -> Insertion:
    """An insertion whose last step has about ``count`` landmarks, half of them anchors."""
    per_side = min(range(2, 30), key=lambda m: abs(len(select_anchors(tissue, m)) - count / 2))
    most = count
    while True:
        insertion = Insertion(tissue, anchors=per_side, max_landmarks=most)
        insertion.advance(needle)
        if len(insertion.anchors) + insertion.landmark_count <= 1.1 * count:
            return insertion
        most = int(0.9 * most)


def whole_step(counts: Sequence[int], rounds: int, tell: Tell, side: int = 53) -> list[Row]:
    """Select, append, solve and evaluate all nodes, against a peer's fit and evaluation of the same landmarks.

    A round's figure is the median of the last five of twenty steps.
    """
    rows: list[Row] = []
    for count in counts:
        tell(f"whole step: {side}^3, n = {count}")
        rows += _whole_step(Tissue(Grid.unit_cube(side)), count, rounds)
    return rows


def _whole_step(tissue: Tissue, count: int, rounds: int) -> list[Row]:
    needles = equal_steps(Needle((0, 0.5, 0.5), (0.9, 0.55, 0.5)), _STEPS)
    insertion = _insertion_with(tissue, needles[-1], count)
    problem = Problem.of(insertion)
    reasons = {c.name: c.unable(problem) or c.unable_to_fit(problem) for c in PEERS}
    ours: list[float] = []
    means: list[float] = []
    theirs: dict[str, list[float]] = {name: [] for name, reason in reasons.items() if reason is None}
    for turn in range(rounds + 1):
        time.sleep(REST_S)
        steps = steps_ms(insertion, needles)
        if turn:  # the first turn warms up
            ours.append(float(np.median(steps[-_STEPS // 4 :])))
            means.append(float(np.mean(steps)))
        for contender in PEERS:
            if contender.name in theirs:
                elapsed = once(partial(contender.step, problem))
                theirs[contender.name] += [elapsed] if turn else []
    mine_times = Times(tuple(ours))
    row: Row = {"nodes": problem.grid.node_count, "landmarks": count, "exact_landmarks": problem.count}
    mean = {"mean_of_all_steps_ms": float(np.median(means))}
    rows = [row | {"contender": "sonospline step", "step": mine_times.as_dict()} | mean]
    for name, reason in reasons.items():
        if reason is not None:
            rows.append(row | {"contender": name, "left_out": reason})
            continue
        times = Times(tuple(theirs[name]))
        rows.append(row | {"contender": name, "step": times.as_dict(), "ratio_to_ours": times.ratio_to(mine_times)})
    return rows


def insertion_step(rounds: int, tell: Tell, side: int = 53) -> list[Row]:
    """Steps with sampled anchors and with every face node pinned, and how far the faces then drift."""
    rows = []
    choices: tuple[int | Literal["all"], ...] = (5, "all")
    for anchors in choices:
        tell(f"insertion: {side}^3, anchors = {anchors}")
        insertion = Insertion(Tissue(Grid.unit_cube(side)), anchors=anchors)
        needles = equal_steps(Needle((0, 0.5, 0.5), (0.6, 0.55, 0.5)), _STEPS)
        spent: list[float] = []
        for _ in range(rounds):
            times = steps_ms(insertion, needles)
            spent += times[-_STEPS // 4 :]
        pinned = insertion.tissue.grid.points[insertion.tissue.pinned.ravel()]
        drift = float(np.abs(insertion.field.displacement(pinned)).max())
        rows.append(
            {"anchors": len(insertion.anchors), "landmarks": insertion.landmark_count, "face_drift": drift}
            | {"step": Times(tuple(spent)).as_dict(), "first_step_ms": times[0]}
        )
    return rows


def multilevel_against_direct(cases: Sequence[tuple[int, int]], rounds: int, tell: Tell) -> list[Row]:
    """Our multilevel sum against our own direct float32 sum."""
    rows = []
    for side, count in cases:
        tell(f"multilevel against direct: {side}^3, n = {count}")
        problem = Problem.make(side, count)
        field = MULTILEVEL.fit(problem)
        times = race({c.name: partial(c.evaluate, problem, field) for c in (MULTILEVEL, DIRECT32)}, rounds)
        multilevel, direct = times[MULTILEVEL.name], times[DIRECT32.name]
        rows.append(
            {"nodes": problem.grid.node_count, "landmarks": count, "multilevel": multilevel.as_dict()}
            | {"direct32": direct.as_dict(), "ratio": direct.ratio_to(multilevel)}
        )
    return rows


def incremental(steps: Sequence[int], rounds: int, tell: Tell, count: int = 1000) -> list[Row]:
    """Append and solve at each step, against a dense LAPACK solve: of all landmarks, and of those of the step."""
    problem = Problem.make(53, count)
    weights, _ = dense_fit(problem)
    rows = []
    for total in steps:
        tell(f"incremental solve: n = {count}, {total} steps")
        ends = np.linspace(problem.anchors, problem.count, total + 1).astype(int)[1:]
        spline = PolyharmonicSpline(problem.landmarks[: problem.anchors])
        spline.reserve(problem.count)
        ours, dense, own = [], [], []
        for _ in range(rounds):
            ours.append(_mean_incremental_ms(spline, problem, ends))
            dense.append(several(partial(_lapack, problem.count), least=5))
            own.append(float(np.mean([several(partial(_lapack, int(end))) for end in ends[:: max(1, total // 5)]])))
        error = float(np.abs(spline.solve(problem.values).weights - weights).max() / np.abs(weights).max())
        mine, whole, each = (Times(tuple(t)) for t in (ours, dense, own))
        rows.append(
            {"landmarks": count, "steps": total, "mean_step": mine.as_dict(), "dense_solve": whole.as_dict()}
            | {"ratio": whole.ratio_to(mine), "ratio_to_own_size": each.ratio_to(mine), "weights_error": error}
        )
    return rows


def _mean_incremental_ms(spline: PolyharmonicSpline, problem: Problem, ends: NDArray[np.int64]) -> float:
    spline.truncate(problem.anchors)
    time.sleep(REST_S)
    starts = [problem.anchors, *ends[:-1]]
    spent = [
        elapsed_ms(partial(_append_and_solve, spline, problem, first, last))
        for first, last in zip(starts, ends, strict=True)
    ]
    return float(np.mean(spent))


def _lapack(count: int) -> None:
    """Solve a dense system of the paper's size (6), (7); making the matrix is left out."""
    system, right = _dense_system(count)
    np.linalg.solve(system, right)


@lru_cache(maxsize=8)
def _dense_system(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    random = np.random.default_rng(0)
    return random.random((count + 4, count + 4)), random.random((count + 4, 3))


def _append_and_solve(spline: PolyharmonicSpline, problem: Problem, first: int, last: int) -> None:
    if last > first:
        spline.append(problem.landmarks[first:last])
    spline.solve(problem.values[:last])


def growth(sides: Sequence[int], counts: Sequence[int], rounds: int, tell: Tell, at: int = 53) -> list[Row]:
    """Cost and memory of the multilevel sum as nodes and landmarks grow."""
    rows = []
    for side, count in [(side, 1000) for side in sides] + [(at, count) for count in counts]:
        tell(f"growth: {side}^3, n = {count}")
        problem = Problem.make(side, count)
        field = MULTILEVEL.fit(problem)
        machine.forget_peak()
        times = race({"multilevel": partial(MULTILEVEL.evaluate, problem, field)}, rounds)["multilevel"]
        rows.append(
            {"nodes": problem.grid.node_count, "landmarks": count, "multilevel": times.as_dict()}
            | {"ns_per_node": 1e6 * times.median / problem.grid.node_count, "peak_gb": machine.peak_gb()}
        )
    return rows


def sampling(rounds: int, tell: Tell) -> Row:
    """A hundred thousand points by interpolation and directly; the inverse of a 512 x 512 image plane."""
    tell("sampling: 100,000 points, 512 x 512 inverse")
    field = MULTILEVEL.fit(Problem.make(53, 300))
    sampled = GridField.of(field)
    points = np.random.default_rng(0).random((100_000, 3))
    axis = np.linspace(0.02, 0.98, 512)
    plane = np.stack([*np.meshgrid(axis, axis, indexing="ij"), np.full((512, 512), 0.5)], axis=-1).reshape(-1, 3)
    ways: dict[str, Callable[[], object]] = {
        "100,000 points, interpolated": partial(sampled.displacement, points),
        "100,000 points, direct": partial(field.displacement, points),
        "512 x 512 inverse, interpolated": partial(sampled.inverse, plane, tolerance=1e-5),
        "512 x 512 inverse, direct": partial(field.inverse, plane, tolerance=1e-5),
    }
    largest, rms = sampled.interpolation_error(field)
    times = {name: t.as_dict() for name, t in race(ways, rounds).items()}
    return {"times": times, "interpolation_error": {"max": largest, "rms": rms}}

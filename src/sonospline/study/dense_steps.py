"""How many landmarks the paper's time per step leaves room for: it names the time, and no number."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ..bench.contenders import Ours, PaperStep
from ..bench.problem import Problem
from ..bench.timing import several
from .one_thread import in_one_thread

Row = dict[str, Any]

SIDE, PAPER_MS = 48, 45.8
"""Nodes a side of the paper's largest mesh, and its time per step there (Sec. V)."""
COUNTS = (10, 25, 50, 100, 200, 400, 800, 1600)


def measure(side: int, counts: Sequence[int]) -> list[Row]:
    """Return the times of dense steps by their number of landmarks, from a process with one thread."""
    rows: list[Row] = in_one_thread(timed, side, counts)
    return rows


def timed(side: int, counts: Sequence[int]) -> list[Row]:
    """Return milliseconds: of the paper's step in NumPy, of its solve alone, of a compiled float64 sum alone."""
    numpy_step, compiled_sum = PaperStep(), Ours("direct")
    rows = []
    for count in counts:
        problem = Problem.make(side, count)
        field = compiled_sum.fit(problem)
        rows.append(
            {
                "landmarks": problem.count,
                "numpy_ms": several(partial(numpy_step.step, problem)),
                "solve_ms": several(partial(numpy_step.fit, problem)),
                "compiled_sum_ms": several(partial(compiled_sum.evaluate, problem, field)),
            }
        )
    return rows


def landmarks_within(rows: list[Row], most_ms: float = PAPER_MS) -> dict[str, int]:
    """Return the landmarks of a step that takes so long, in NumPy and with a compiled sum."""
    counts = [row["landmarks"] for row in rows]
    steps = {
        "numpy": [row["numpy_ms"] for row in rows],
        "compiled": [row["solve_ms"] + row["compiled_sum_ms"] for row in rows],
    }
    return {way: round(float(np.interp(most_ms, times, counts))) for way, times in steps.items()}

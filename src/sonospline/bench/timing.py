"""Fair timing: contenders take turns, and a ratio is the median of the ratios of each turn."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..geometry.needle import Needle
from ..models.insertion import NeedleInsertion

REST_S = 0.2
"""Pause before each measurement: the thread pools of other libraries spin for up to 0.1 s after their work."""


@dataclass(frozen=True)
class Times:
    """Milliseconds of each round."""

    rounds: tuple[float, ...]

    @property
    def median(self) -> float:
        return float(np.median(self.rounds))

    def as_dict(self) -> dict[str, float | int]:
        return {
            "median_ms": self.median,
            "min_ms": min(self.rounds),
            "max_ms": max(self.rounds),
            "rounds": len(self.rounds),
        }

    def ratio_to(self, other: Times) -> float:
        """How many times longer this took: the median over rounds, pair by pair."""
        return float(np.median([a / b for a, b in zip(self.rounds, other.rounds, strict=True)]))


def elapsed_ms(function: Callable[[], object]) -> float:
    """Return the milliseconds of one call."""
    start = time.perf_counter()
    function()
    return 1e3 * (time.perf_counter() - start)


def steps_ms(insertion: NeedleInsertion, needles: Sequence[Needle]) -> list[float]:
    """Return the milliseconds of each step of a new insertion, all nodes of the grid evaluated."""
    insertion.reset()
    return [elapsed_ms(partial(_step, insertion, needle)) for needle in needles]


def _step(insertion: NeedleInsertion, needle: Needle) -> None:
    insertion.advance(needle).on_grid()


def once(function: Callable[[], object]) -> float:
    """Return the milliseconds of one call, after a rest."""
    time.sleep(REST_S)
    return elapsed_ms(function)


def several(function: Callable[[], object], budget_ms: float = 60.0, least: int = 3, most: int = 25) -> float:
    """Return the median milliseconds of several calls in a row: a short one is not measured alone."""
    spent: list[float] = []
    time.sleep(REST_S)
    while len(spent) < least or (sum(spent) < budget_ms and len(spent) < most):
        spent.append(elapsed_ms(function))
        if sum(spent) > 1500:  # long ones are steady enough
            break
    return float(np.median(spent))


def race(ways: dict[str, Callable[[], object]], rounds: int) -> dict[str, Times]:
    """Time every way in turn, ``rounds`` times, after one round that does not count."""
    measured: dict[str, list[float]] = {name: [] for name in ways}
    gc.collect()
    gc.disable()
    try:
        for way in ways.values():
            way()
        for _ in range(rounds):
            for name, way in ways.items():
                measured[name].append(several(way))
    finally:
        gc.enable()
    return {name: Times(tuple(values)) for name, values in measured.items()}

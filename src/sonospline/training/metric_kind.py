"""What a metric is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from .task import Task
    from .trace import Trace

Of = Callable[["Trace", "Task"], float]
Better = Literal["less", "more", "neither"]


@dataclass(frozen=True)
class Metric:
    """One number of an attempt.

    Parameters
    ----------
    name : str
        Its unit at the end, where it has one.
    unit : str
        ``"mm"``, ``"s"``, ``"%"``, ``"deg"``, ``"N"``, ``"mm^2"``; empty for a count or a ratio.
    definition : str
        In one or two sentences.
    source : str
        Who defined it; ``"own"`` where nobody did before.
    better : {"less", "more", "neither"}
        Which way an expert differs from a novice.
    of : callable
        Computes it from a trace and a task.
    """

    name: str
    unit: str
    definition: str
    source: str
    better: Better
    of: Of

    def __repr__(self) -> str:
        return f"Metric({self.name!r}, unit={self.unit!r}, better={self.better!r})"


def metric(table: list[Metric], unit: str, better: Better = "less", source: str = "own") -> Callable[[Of], Of]:
    """Put a function into a table of metrics: its name and its docstring are the metric's."""

    def taken(function: Of) -> Of:
        definition = " ".join((function.__doc__ or "").split())
        table.append(Metric(function.__name__, unit, definition, source, better, function))
        return function

    return taken

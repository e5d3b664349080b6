"""What the numbers of a data set's table are like."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from .reader import DataSet
from .table_form import NUMBERS


def statistics(data: DataSet) -> dict[str, Any]:
    """Return counts by split, target and event, and the spread of each number of the table.

    Raises
    ------
    ValueError
        A data set of recipes, whose table has no numbers.
    """
    if data.form == "recipe":
        raise ValueError(f"{data.store.address!r} holds recipes alone, which have no numbers; rebuild it first")
    splits, targets, events = Counter[str](), Counter[str](), Counter[str]()
    numbers: dict[str, list[float]] = {name: [] for name in NUMBERS}
    for row in data.rows(columns=[*NUMBERS, "target", "events"]):
        splits[row["split"]] += 1
        targets[row["target"]] += 1
        events.update(_kind(event) for event in row["events"] or ())
        for name in NUMBERS:
            if row[name] is not None:
                numbers[name].append(row[name])
    return {
        "samples": splits.total(), "failed": len(data.failed), "splits": dict(splits), "targets": dict(targets),
        "events": dict(events), "numbers": {name: _spread(values) for name, values in numbers.items() if values},
    }  # fmt: skip


def _kind(event: str) -> str:
    """An event without its numbers."""
    return event.partition(" at ")[0]


def _spread(values: list[float]) -> dict[str, float]:
    low, fifth, middle, most, high = np.quantile(values, (0, 0.05, 0.5, 0.95, 1))
    parts = {"mean": np.mean(values), "least": low, "q05": fifth, "median": middle, "q95": most, "largest": high}
    return {name: float(value) for name, value in parts.items()}

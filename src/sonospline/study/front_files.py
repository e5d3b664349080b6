"""A Pareto front as a table and as a picture."""

from __future__ import annotations

import csv
import io
from itertools import combinations
from pathlib import Path
from typing import Any

from ..io.canvas import picture
from ..io.writing import write_text
from .objective import TUNABLES
from .tuning import ParetoFront


def rows(front: ParetoFront, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return a dictionary a design: its parameters in cube sides, its errors by insertion, whether it is chosen."""
    return [
        {
            **{tunable.name: float(value) for tunable, value in zip(TUNABLES, design, strict=True)},
            **{f"mae_{name}": float(error) for name, error in zip(names, errors, strict=True)},
            "mean_mae": float(errors.mean()),
            "chosen": number == front.chosen,
        }
        for number, (design, errors) in enumerate(zip(front.designs, front.objectives, strict=True))
    ]


def write_csv(front: ParetoFront, names: tuple[str, ...], path: Path) -> None:
    """Write the table that :func:`rows` gives."""
    table = rows(front, names)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(table[0]))
    writer.writeheader()
    writer.writerows(table)
    write_text(path, text.getvalue())


def draw(front: ParetoFront, names: tuple[str, ...], path: Path) -> None:
    """Write the picture: each pair of objectives, the chosen design marked."""
    pairs = list(combinations(range(len(names)), 2))
    best = front.objectives[front.chosen]
    with picture(path, 4.2 * len(pairs), 4) as figure:
        panels = figure.subplots(1, len(pairs), squeeze=False)[0]
        for panel, (a, b) in zip(panels, pairs, strict=True):
            panel.plot(
                1e3 * front.objectives[:, a], 1e3 * front.objectives[:, b], "o", ms=5, color="#2f6f9f", label="front"
            )
            panel.plot(1e3 * best[a], 1e3 * best[b], "*", ms=15, color="#ff5a36", label="chosen: least mean error")
            panel.set_xlabel(f"MAE of {names[a]} (1e-3 sides)")
            panel.set_ylabel(f"MAE of {names[b]} (1e-3 sides)")
        panels[0].legend()

"""Whether anchors keep the pinned faces where they are, however often the needle goes in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ..geometry.grid import Grid
from ..geometry.needle import Needle, equal_steps
from ..geometry.tissue import Tissue
from ..mechanics.interaction import NeedleTissueModel
from ..models.spline.insertion import Insertion
from .insertions import PlannedInsertion

Row = dict[str, Any]

STEPS, TIMES_AS_MANY = 20, 5
"""Of a pass into the tissue; and in how many passes, or steps of the moving mesh, it is done again."""
ANCHORS: tuple[int | Literal["all"], ...] = (2, 5, "all")
"""A side of a face: the corners alone, as the default has them, every node."""


def measure(side: int, insertions: Sequence[PlannedInsertion]) -> list[Row]:
    """Return how far pinned nodes move at most in any of the insertions, by anchors and number of updates.

    Section V maps the undeformed nodes (accumulation ``"maximum"``): the needle goes in and out again and again.
    Algorithm 1 as printed moves its mesh (``"incremental"``), which cannot pull back: the same way is gone in
    more, smaller steps. ``drift`` is in cube sides, ``share`` of the largest displacement.
    """
    tissue = Tissue(Grid.unit_cube(side))
    needles = [plan.on(tissue) for plan in insertions]
    return [
        max(group, key=lambda row: row["drift"])
        for group in zip(*([*_passes(tissue, needle), *_steps(tissue, needle)] for needle in needles), strict=True)
    ]


def _passes(tissue: Tissue, whole: Needle) -> Iterator[Row]:
    inward = equal_steps(whole, STEPS)
    again = TIMES_AS_MANY * (inward[-2::-1] + inward[1:])
    for anchors in ANCHORS:
        insertion = Insertion(tissue, NeedleTissueModel.paper(), anchors=anchors)
        for path, updates in ((inward, len(inward)), (again, len(inward + again))):
            for needle in path:
                insertion.advance(needle)
            yield _row(insertion, updates)


def _steps(tissue: Tissue, whole: Needle) -> Iterator[Row]:
    for anchors in (a for a in ANCHORS if a != "all"):  # a moving mesh cannot keep their factor
        for count in (STEPS, STEPS * TIMES_AS_MANY):
            insertion = Insertion(tissue, _increments(count), anchors=anchors, accumulation="incremental")
            for needle in equal_steps(whole, count):
                insertion.advance(needle)
            yield _row(insertion, count)


def _increments(steps: int) -> NeedleTissueModel:
    """Algorithm 1's displacements of a step, such that so many steps add up to what the usual number do."""
    model = NeedleTissueModel.paper_incremental()
    amplitudes = ("shaft_displacement", "shaft_pull", "tip_displacement")
    return replace(model, **{name: getattr(model, name) * STEPS / steps for name in amplitudes})


def _row(insertion: Insertion, updates: int) -> Row:
    displacement = np.asarray(insertion.field.on_grid("direct"))
    drift = insertion.tissue.boundary_drift(displacement)
    return {
        "accumulation": insertion.accumulation,
        "anchors": len(insertion.anchors),
        "updates": updates,
        "drift": drift,
        "share": drift / float(np.linalg.norm(displacement, axis=-1).max()),
    }

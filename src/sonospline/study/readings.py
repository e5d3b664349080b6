"""What the paper can mean: the readings of Table I, of Algorithm 1 and of epsilon, against finite elements.

Table I gives eight lengths without units and Algorithm 1 updates its mesh, while Section V
maps the undeformed nodes. Each reading is run and measured; the defaults are those that hold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle, equal_steps
from ..mechanics.interaction import TABLE_I_SPACING, NeedleTissueModel, interaction
from ..mechanics.landmarks import plan_landmarks, select_anchors
from ..models.spline.faces import Progress
from ..models.spline.insertion import Insertion
from ..models.spline.spline import PolyharmonicSpline
from .metrics import displacement_errors, mean_errors
from .reference import Reference

Array = NDArray[np.float64]
Row = dict[str, Any]

_ANCHORS, _LANDMARKS = 5, 300
_TIP = ("tip_radius", "tip_length")
_SHAFT = ("shaft_radius", "shaft_decay", "pull_decay")
_AMPLITUDES = ("shaft_displacement", "shaft_pull", "tip_displacement")


def compare_readings(
    references: Sequence[Reference], *, steps: int = 20, progress: Progress | None = None
) -> list[Row]:
    """Return every reading of the paper and its mean errors at the last depth of some references.

    Parameters
    ----------
    references : sequence of Reference
        Insertions to compare on.
    steps : int, default: 20
        Steps in which readings that depend on them reach the last depth.
    progress : callable, optional
        Called as ``progress(done, of)`` after each reading.

    Returns
    -------
    list of dict
        ``group`` (what is varied: units, rows or epsilon), ``name`` (how Table I is read), ``accumulation`` (how
        displacements accumulate over the steps); ``mae``, ``rmse``, ``relative`` and ``largest_displacement``, None
        where the reading gives no field, and ``failure``, why it gives none.
    """
    if not references:
        raise ValueError("references is empty; give those of at least one insertion")
    side = references[0].tissue.grid.side
    readings = [*_units(side), *_rows(side), *_epsilons(side)]
    found = []
    for done, (group, name, accumulation, model, rule) in enumerate(readings, 1):
        found.append(_measure(references, group, name, accumulation, model, partial(rule, steps=steps)))
        if progress:
            progress(done, len(readings))
    return found


def _measure(
    references: Sequence[Reference], group: str, name: str, accumulation: str, model: NeedleTissueModel, rule: Any
) -> Row:
    errors, largest, failure = [], [], ""
    try:
        for reference in references:
            last = reference.last
            displacement = rule(reference, model)
            tip, grid = last.needle(0).tip, reference.tissue.grid
            errors.append(displacement_errors(displacement, last.displacements[0], grid=grid, tip=tip))
            largest.append(float(np.linalg.norm(displacement, axis=-1).max()))
    except (ValueError, np.linalg.LinAlgError) as error:
        errors, largest, failure = [], [], str(error)
    mean = mean_errors(errors) if errors else None
    return {
        "group": group,
        "name": name,
        "accumulation": accumulation,
        **{measure: getattr(mean, measure, None) for measure in ("mae", "rmse", "relative")},
        "largest_displacement": max(largest, default=None),
        "failure": failure,
    }


def _units(side: float) -> Iterator[tuple[str, str, str, NeedleTissueModel, Any]]:
    """Units of the lengths and displacements, under each way to accumulate."""
    adopted = NeedleTissueModel.paper(side)
    spacing = TABLE_I_SPACING
    in_sides = _times(adopted, 1 / spacing, _TIP)
    in_spacings = _times(adopted, spacing, _SHAFT)
    models = {
        "shaft in sides, tip lengths in k": (adopted, ACCUMULATIONS),
        "all lengths in sides": (in_sides, FROM_REFERENCE),
        "all lengths in k": (in_spacings, FROM_REFERENCE),
        "lengths and displacements in k": (_times(in_spacings, spacing, _AMPLITUDES), FROM_REFERENCE),
        "tip lengths and displacements in k": (_times(adopted, spacing, _AMPLITUDES), PER_STEP),
    }
    for name, (model, rules) in models.items():
        for accumulation, rule in rules.items():
            yield "units", name, accumulation, model, rule


def _rows(side: float) -> Iterator[tuple[str, str, str, NeedleTissueModel, Any]]:
    """Which of delta, sigma_s and sigma_c the table's two numbers are."""
    adopted = NeedleTissueModel.paper(side)
    wide, narrow = adopted.shaft_radius, adopted.shaft_decay
    models = {
        "delta = .3873 = 3 sigma_s, sigma_c = sigma_s": (wide, narrow, narrow),
        "delta = .3873, sigma_s = .1291, sigma_c = .3873": (wide, narrow, wide),
        "delta = .1291, sigma_s = sigma_c = .3873": (narrow, wide, wide),
        "delta = sigma_s = .1291, sigma_c = .3873": (narrow, narrow, wide),
        "delta = .1291 = 3 sigma_s, sigma_c = sigma_s": (narrow, narrow / 3, narrow / 3),
    }
    for name, (radius, decay, pull_decay) in models.items():
        model = replace(adopted, shaft_radius=radius, shaft_decay=decay, pull_decay=pull_decay)
        yield "rows", name, "maximum", model, _maximum


def _epsilons(side: float) -> Iterator[tuple[str, str, str, NeedleTissueModel, Any]]:
    """The sign of epsilon on the diagonal, in units of the smallest landmark distance."""
    model = NeedleTissueModel.paper(side)
    for name, epsilon in {
        "eps = 0": 0.0,
        "+eps = 0.1 h, the paper's sign": 0.1,
        "+eps = 0.29 h": 0.29,
        "+eps = 0.5 h": 0.5,
        "-eps = 0.1 h, smoothing": -0.1,
        "-eps = 0.29 h": -0.29,
    }.items():
        yield "epsilon", name, "current", model, partial(_current, epsilon=epsilon)


def _maximum(reference: Reference, model: NeedleTissueModel, steps: int) -> Array:
    insertion = Insertion(reference.tissue, model, anchors=_ANCHORS, max_landmarks=_LANDMARKS)
    return np.asarray(insertion.advance(_needle(reference)).on_grid("direct"))


def _moving_mesh(reference: Reference, model: NeedleTissueModel, steps: int) -> Array:
    insertion = Insertion(reference.tissue, model, anchors=_ANCHORS, accumulation="incremental")
    needle = _needle(reference)
    *_, field = insertion.run(needle.entry, needle.tip, steps)
    return np.asarray(field.on_grid())


def _current(reference: Reference, model: NeedleTissueModel, steps: int, epsilon: float = 0.0) -> Array:
    """What the needle does at its last depth alone, from the undeformed nodes."""
    return _from_reference(reference, model, [_needle(reference)], epsilon)


def _additive(reference: Reference, model: NeedleTissueModel, steps: int) -> Array:
    """The sum of what it does at every step, from the undeformed nodes."""
    needle = _needle(reference)
    return _from_reference(reference, model, equal_steps(needle, steps))


def _from_reference(
    reference: Reference, model: NeedleTissueModel, needles: list[Needle], epsilon: float = 0.0
) -> Array:
    tissue = reference.tissue
    anchors = select_anchors(tissue, _ANCHORS)
    plan = plan_landmarks(tissue, needles[-1], model, max_landmarks=_LANDMARKS)
    values = np.sum([interaction(plan.points, needle, model) for needle in needles], axis=0)
    moved = values.any(axis=1)
    points = np.concatenate([anchors, plan.points[moved]])
    diagonal = epsilon * min(tissue.grid.spacing)
    field = PolyharmonicSpline.fit(
        points,
        np.concatenate([np.zeros_like(anchors), values[moved]]),
        smoothing=max(-diagonal, 0.0),
        paper_epsilon=max(diagonal, 0.0),
        grid=tissue.grid,
    )
    return np.asarray(field.on_grid("direct"))


def _needle(reference: Reference) -> Needle:
    return reference.last.needle(0)


def _times(model: NeedleTissueModel, factor: float, names: tuple[str, ...]) -> NeedleTissueModel:
    return replace(model, **{name: getattr(model, name) * factor for name in names})


FROM_REFERENCE = {"maximum": _maximum, "current": _current, "additive": _additive}
PER_STEP = {"additive": _additive, "moving mesh": _moving_mesh}
ACCUMULATIONS = {**FROM_REFERENCE, "moving mesh": _moving_mesh}

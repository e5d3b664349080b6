"""What the models of tissue say a needle does on its way, live and at rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..models.elastic import ElasticModel
from ..models.insertion import NeedleInsertion
from .specimens import Specimen

Array = NDArray[np.float64]
Row = dict[str, Any]

REFERENCE_ERROR = 1e-4
"""Error estimate of a converged field."""


def elastic(specimen: Specimen, nodes: int | None) -> NeedleInsertion:
    """Return the elastic model in a specimen, on so many nodes of its own, or on as many as it takes by itself.

    In cubes, where it is set beside kernels that were tuned on linear fields, its load stays where it is stated.
    """
    chosen: dict[str, Any] = {} if nodes is None else {"nodes": nodes}
    chosen["load_at"] = "deformed" if specimen.real else "undeformed"
    return NeedleInsertion(ElasticModel(specimen.tissue, specimen.tissues, specimen.load, **chosen))


def converged(specimen: Specimen, needles: list[Needle], nodes: int) -> list[Array]:
    """Return the displacement at each pose, at rest and then iterated further."""
    insertion, fields = elastic(specimen, nodes), []
    for needle in needles:
        insertion.advance(needle)
        fields.append(_at_rest(insertion))
    return fields


def _at_rest(insertion: NeedleInsertion) -> Array:
    insertion.settle()
    model = insertion.tissue_model
    assert isinstance(model, ElasticModel)
    return np.asarray(model.settle(insertion.response, tolerance=REFERENCE_ERROR).field.on_grid(), float)


def live(insertion: NeedleInsertion, needles: list[Needle], steps: int) -> list[Array]:
    """Return the displacement at the poses of an insertion that takes so many steps to the last of them."""
    whole, fields = needles[-1], []
    for number, needle in enumerate(needles):
        first, last = (round(steps * k / len(needles)) for k in (number, number + 1))
        for step in range(first + 1, last + 1):
            insertion.advance(Needle(whole.entry, whole.at(step / steps)) if step < last else needle)
        fields.append(np.asarray(insertion.field.on_grid(), float))
    return fields


def honesty(insertion: NeedleInsertion, last: Array) -> Row:
    """Return the error that a live field publishes, and its distance from the same grid's converged field."""
    published, rest = insertion.response.error_estimate, _at_rest(insertion)
    missing, moved = (float(np.linalg.norm(field, axis=-1).mean()) for field in (last - rest, rest))
    return {"published": published, "iteration": missing / moved}


def at_pose(insertion: NeedleInsertion, needle: Needle) -> Array:
    """Return the displacement of a needle that was nowhere before."""
    insertion.reset()
    return np.asarray(insertion.advance(needle).on_grid("accurate"), float)


def factor(field: Array, reference: Array) -> float:
    """Return what a field is to be multiplied by to be nearest to the reference."""
    return float(np.vdot(field, reference) / np.vdot(field, field))

"""What the search minimises: equation (24), and the seven parameters it may turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from ..mechanics.amortised import TUNED, of_seven
from ..mechanics.interaction import NeedleTissueModel
from ..models.spline.insertion import Insertion
from .metrics import Errors, mean_errors
from .reference import Reference, errors_along

Array = NDArray[np.float64]


class Tunable(NamedTuple):
    """A parameter of the search and the range it is searched in, in cube sides."""

    name: str
    symbol: str
    low: float
    high: float


_SEARCHED = (
    ("f_max", 0.0, 0.05), ("gamma_max", 0.0, 0.01), ("sigma_s", 0.05, 0.30), ("sigma_c", 0.01, 0.30),
    ("sigma_tip", 0.0, 0.05), ("r_tip", 0.01, 0.12), ("l_tip", 0.01, 0.20),
)  # fmt: skip
TUNABLES = tuple(Tunable(name, *range_) for name, range_ in zip(TUNED, _SEARCHED, strict=True))
"""The seven parameters of Table I; delta follows sigma_s. An optimum at a bound is no optimum: look at them."""


def model_of(design: ArrayLike, side: float = 1.0) -> NeedleTissueModel:
    """Return the model that a design (7,), in cube sides and the order of ``TUNABLES``, describes.

    Examples
    --------
    >>> from sonospline.study.objective import model_of
    >>> model_of([.02, .002, .15, .02, .02, .03, .04]).shaft_radius
    0.45
    """
    values = np.asarray(design, float)
    if values.shape != (len(TUNABLES),):
        raise ValueError(f"design has shape {values.shape}; give the {len(TUNABLES)} numbers of TUNABLES")
    return of_seven(values.tolist()).scaled(side)


@dataclass(frozen=True, eq=False)
class Objective:
    """The fitness vector f(x) = [MAE_1, MAE_2, MAE_3], eq. (24), one entry an insertion.

    Each is the mean over the depths of its reference, on all nodes that move. Fields are
    summed to 1e-6 of the side, a thousandth of the errors. Can be sent to other processes.

    Parameters
    ----------
    references : tuple of Reference
        The insertions to tune on.
    max_landmarks : int, default: 300
        As for :class:`Insertion`.
    """

    references: tuple[Reference, ...]
    max_landmarks: int = 300

    def __post_init__(self) -> None:
        if not self.references:
            raise ValueError("references is empty; give those of at least one insertion")
        _validate.count("max_landmarks", self.max_landmarks)

    def __call__(self, design: ArrayLike) -> Array:
        """Return the errors (one an insertion) of a design (7,)."""
        found = []
        for reference in self.references:
            model = model_of(design, reference.tissue.grid.side)
            insertion = Insertion(reference.tissue, model, max_landmarks=self.max_landmarks)
            found.append(np.mean([errors.mae for errors in errors_along(insertion, reference, method="accurate")]))
        return np.array(found)


def errors_at_target(
    references: tuple[Reference, ...], model: NeedleTissueModel, *, max_landmarks: int = 300
) -> dict[str, Errors]:
    """Return the errors of a model at the last depth of each insertion, by its name, and their ``"mean"``."""
    found = {
        reference.plan.name: errors_along(
            Insertion(reference.tissue, model, max_landmarks=max_landmarks), reference.last
        )[0]
        for reference in references
    }
    return {**found, "mean": mean_errors(list(found.values()))}

"""A finite element reference of one insertion, and the errors of a model along it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..fem.history import reference_history
from ..fields.maps import Method
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..models.insertion import NeedleInsertion
from .insertions import PlannedInsertion
from .metrics import Errors, displacement_errors

Array = NDArray[np.float64]
Solver = Callable[..., Array]
"""Called as ``history(tissue, entry, target, steps=)``; returns (steps, nx, ny, nz, 3)."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Where the reference says the tissue goes while a needle advances.

    Parameters
    ----------
    plan : PlannedInsertion
        The insertion.
    tissue : Tissue
        The block it goes into.
    depths : (m,) array_like
        Fractions of the way from entry to target, rising, above 0 and up to 1.
    displacements : (m, nx, ny, nz, 3) ndarray
        Displacement of each node at each depth, in the unit of the grid.

    Raises
    ------
    ValueError
        Arrays that do not fit one another or the grid, or depths out of range or order.
    """

    plan: PlannedInsertion
    tissue: Tissue
    depths: tuple[float, ...]
    displacements: Array

    def __post_init__(self) -> None:
        depths = tuple(float(depth) for depth in self.depths)
        if not depths or min(depths) <= 0 or max(depths) > 1 or list(depths) != sorted(set(depths)):
            raise ValueError(f"depths = {depths} are not rising fractions; give some above 0 and up to 1")
        wanted = (len(depths), *self.tissue.grid.shape, 3)
        if self.displacements.shape != wanted:
            raise ValueError(f"displacements has shape {self.displacements.shape}; give {wanted}")
        object.__setattr__(self, "depths", depths)

    @classmethod
    def solve(
        cls,
        plan: PlannedInsertion,
        tissue: Tissue,
        *,
        steps: int = 20,
        history: Solver = reference_history,
        **options: Any,
    ) -> Reference:
        """Return the reference of an insertion in equal steps.

        Parameters
        ----------
        plan, tissue
            As for :class:`Reference`.
        steps : int, default: 20
            Equal steps from entry to target.
        history : callable, default: sonospline.fem.reference_history
            Where the displacements come from; those are kept on disk.
        **options
            Passed on to it: load, material, element, integration, engine.
        """
        steps = _validate.count("steps", steps)
        needle = plan.on(tissue)
        displacements = history(tissue, needle.entry, needle.tip, steps=steps, **options)
        return cls(plan, tissue, tuple((np.arange(1, steps + 1) / steps).tolist()), displacements)

    def at(self, numbers: Iterable[int]) -> Reference:
        """Return the reference at some of its depths only, by their number from 0."""
        chosen = list(numbers)
        return Reference(self.plan, self.tissue, tuple(self.depths[i] for i in chosen), self.displacements[chosen])

    @property
    def last(self) -> Reference:
        """The reference at its last depth only."""
        return self.at([len(self.depths) - 1])

    def needle(self, number: int) -> Needle:
        """Return the needle at one of the depths, by its number from 0."""
        whole = self.plan.on(self.tissue)
        return Needle(whole.entry, whole.at(self.depths[number]))


def errors_along(
    insertion: NeedleInsertion, reference: Reference, *, threshold: float = 0.0, method: Method = "direct"
) -> list[Errors]:
    """Return the errors of an insertion at each depth of a reference.

    Parameters
    ----------
    insertion : NeedleInsertion
        The model, on the reference's grid; its needle is advanced.
    reference : Reference
        What it is compared with.
    threshold : float, default: 0.0
        Reference displacement above which a node counts.
    method : str, default: "direct"
        How fields are summed, as for :meth:`Field.on_grid`.

    Raises
    ------
    ValueError
        The two live on different grids.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> from sonospline.study.insertions import tuning_insertions
    >>> from sonospline.study.reference import Reference, errors_along
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(9))
    >>> still = Reference(tuning_insertions()[0], tissue, (1.0,), np.full((1, 9, 9, 9, 3), 1e-3))
    >>> [errors.nodes for errors in errors_along(ss.Insertion(tissue), still)]
    [729]
    """
    grid = reference.tissue.grid
    if insertion.tissue.grid.shape != grid.shape:
        raise ValueError(f"insertion has a grid of {insertion.tissue.grid.shape} nodes; give one of {grid.shape}")
    needles = [reference.needle(number) for number in range(len(reference.depths))]
    return [
        displacement_errors(
            insertion.advance(needle).on_grid(method), moved, threshold=threshold, grid=grid, tip=needle.tip
        )
        for needle, moved in zip(needles, reference.displacements, strict=True)
    ]

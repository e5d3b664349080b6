"""How a kernel sum is taken on all nodes of a grid: directly, or multilevel at a tolerance.

The multilevel sum costs nearly the same for any number of landmarks, but they must lie on
nodes of the grid. Its error is governed by the tolerance below which corrections are left
out; the loosest one that keeps the promised accuracy is the fastest.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _core

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PROMISES = {"multilevel": 1e-5, "accurate": 1e-6}
"""Largest error of each method against the float64 direct sum, in box sides."""

_TOLERANCES = (
    *((3e-5, (6, 8, 8)), (1.7e-5, (6, 8, 8)), (1e-5, (6, 8, 8)), (3e-6, (8, 8, 8))),
    *((1e-6, (8, 10, 10)), (3e-7, (10, 10, 10))),
)
"""Correction cut-off in box sides, and interpolation orders that suit it; fastest first."""
_ERROR_PER_WEIGHT = 1.7
"""Largest measured error over cut-off times the root of the weights' sum of squares. The proven bound
(with the plain sum of weights) is tens to hundreds of times larger than the errors that occur."""
_ROUNDING = 2e-7
_ON_NODE = 1e-6
"""A landmark this near to a node, in spacings, lies on it."""


class LatticeSum(NamedTuple):
    """A multilevel sum ready to be taken."""

    plan: Any
    nodes: Index
    """(n, 3) lattice index of the landmarks."""
    depth: int
    """Levels of the plan to use."""


def node_index(centres: Array, shape: tuple[int, int, int], spacing: tuple[float, ...]) -> Index | None:
    """Return the lattice index (n, 3) of landmarks in the lattice's coordinates; None where one is off the nodes."""
    position = centres / spacing
    nearest = np.rint(position)
    if np.abs(position - nearest).max(initial=0.0) > _ON_NODE:
        return None
    index = nearest.astype(np.int64)
    inside = index.min(initial=0) >= 0 and (index.max(axis=0, initial=0) < shape).all()
    return index if inside else None


def choose(
    shape: tuple[int, int, int], spacing: tuple[float, ...], nodes: Index, weights: Array, promise: float
) -> LatticeSum | None:
    """Return the fastest multilevel sum that keeps a promise; None where there is none.

    There is none where the cells are too long for their width (``spacing`` is in box
    sides), or no cut-off is fine enough for such large weights. A depth of 0 says that the
    direct sum costs less.
    """
    finest = (promise - _ROUNDING) / (_ERROR_PER_WEIGHT * max(_size(weights), 1e-300))
    for tolerance, orders in _TOLERANCES:
        if tolerance <= finest:
            plan = _plan(_core.active.MultilevelPlan, shape, spacing, tolerance, orders)
            return plan and LatticeSum(plan, nodes, plan.depth(len(nodes)))
    return None


def _size(weights: Array) -> float:
    """Root of the sum of squares of one component's weights, the largest of the three."""
    return float(np.sqrt(np.einsum("ja,ja->a", weights, weights).max()))


@lru_cache(maxsize=8)
def _plan(
    maker: Any, shape: tuple[int, int, int], spacing: tuple[float, ...], tolerance: float, orders: tuple[int, ...]
) -> Any:
    """Plans hold tables and scratch memory: made once for a grid."""
    try:
        return maker(shape, spacing, tolerance, list(orders))
    except ValueError:  # cells so long that the corrections never die out
        return None

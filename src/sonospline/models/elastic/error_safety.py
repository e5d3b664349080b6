"""How much larger than its estimate an error may be: asked of the multigrid cycle itself.

The estimate of an error e is V A e, with V the cycle that is nearly the inverse of the
operator A. In uniform tissue it is 0.7 of the error or more; beside bone, where coarse grids
know little of the fine one, 0.2 of what is left after some iterations. With no load the
displacement is itself the error, so that the ratio can be read off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]

UNIFORM = 1.7
"""In uniform tissue, and nowhere less."""
_MARGIN = 1.25
_ITERATIONS = 8
"""So many leave of an error what iterations are slow at; insertions of 10 to 200 steps leave no worse."""


def error_safety(multigrid: Any, pinned: NDArray[np.bool_]) -> float:
    """Return the factor that makes estimates of a multigrid solver errors, or a little more.

    The errors tried begin as the answers to a uniform force along each axis, which bone that
    tissue carries feels most.
    """
    zero = np.zeros((3, *pinned.shape), np.float32)
    honest = min(_ratio(multigrid, _uniform(zero, axis, ~pinned), zero) for axis in range(3))
    return max(UNIFORM, _MARGIN / honest)


def _ratio(multigrid: Any, force: Single, zero: Single) -> float:
    """Smallest ratio of estimate to error, of what the last two iterations leave."""
    error, _, _ = multigrid.iterate(force, zero, 1, False)
    seen: list[float] = []
    for iteration in range(_ITERATIONS):
        late = iteration >= _ITERATIONS - 2
        error, estimates, _ = multigrid.iterate(zero, error / np.abs(error).max(), 1, late)
        seen += estimates[-1:] if late else []
    return float(min(seen))


def _uniform(zero: Single, axis: int, free: NDArray[np.bool_]) -> Single:
    force = zero.copy()
    force[axis][free] = 1.0
    return force

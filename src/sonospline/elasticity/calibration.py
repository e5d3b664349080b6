"""How much larger than its estimate an error may be.

The estimate of an error e is V A e, with V the cycle that is nearly the inverse of the
operator A. In uniform tissue and beside bone that does not move it is 0.7 of the error or more; where
tissue is thousands of times stiffer than its surroundings 0.2 of what is left after some iterations. So the
multigrid cycle itself is asked: with no load the displacement is the error, and the ratio can be read off.
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
"""Of the answers to a uniform force: so many leave of an error what iterations are slow at."""
_LOCAL, _LOCAL_ITERATIONS = 6, 3
"""Forces at a place, and iterations of the answers to them: so many as a frame takes, and some."""


def error_safety(multigrid: Any, fixed: NDArray[np.bool_]) -> float:
    """Return the factor that makes estimates of a multigrid solver errors, or a little more.

    The errors tried begin as the answers to a uniform force along each axis, which tissue that
    carries stiff inclusions feels most, and to forces at places all over the tissue, as of a needle's tip.
    """
    zero = np.zeros((3, *fixed.shape), np.float32)
    ratios = [_smallest_ratio(multigrid, _uniform(zero, axis, ~fixed), _ITERATIONS) for axis in range(3)]
    ratios += [_smallest_ratio(multigrid, force, _LOCAL_ITERATIONS) for force in _local(zero, ~fixed)]
    return max(UNIFORM, _MARGIN / min(ratios))


def _smallest_ratio(multigrid: Any, force: Single, iterations: int) -> float:
    """Of estimate to error, of what the last two iterations leave."""
    zero = np.zeros_like(force)
    error, _, _ = multigrid.iterate(force, zero, 1, False)
    seen: list[float] = []
    for iteration in range(iterations):
        late = iteration >= iterations - 2
        error, estimates, _ = multigrid.iterate(zero, error / np.abs(error).max(), 1, late)
        seen += estimates[-1:] if late else []
    return float(min(seen))


def _uniform(zero: Single, axis: int, free: NDArray[np.bool_]) -> Single:
    force = zero.copy()
    force[axis][free] = 1.0
    return force


def _local(zero: Single, free: NDArray[np.bool_]) -> list[Single]:
    """Forces at nodes chosen once and for all, in directions of their own."""
    rng, places = np.random.default_rng(0), np.argwhere(free)
    forces = []
    for place in places[rng.integers(len(places), size=_LOCAL)]:
        force = zero.copy()
        force[:, *place] = rng.normal(size=3)
        forces.append(force)
    return forces

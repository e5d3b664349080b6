"""The default engine: matrices by scikit-fem, solution by PyAMG or SciPy."""

from __future__ import annotations

import time
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from .engine import Engine, Mask, StepTimes, System
from .scikit_assembly import Matrices, assemble
from .sparse_solvers import Factor, Jacobi, Multigrid, Solver

Array = NDArray[np.float64]


class ScikitFem(Engine):
    """Matrices and preconditioner are kept from load to load, unless the solver is "from_scratch".

    Many threads may solve at once with the hierarchy that is kept.
    """

    def __init__(self, system: System) -> None:
        require("skfem")
        if system.solver == "multigrid":
            require("pyamg")
        self._system = system
        self._free = np.flatnonzero(~system.pinned)
        self._matrices: Matrices | None = None
        self._solver: Solver | None = None
        self._making = Lock()

    def __reduce__(self) -> Any:
        return type(self), (self._system,)

    def solve(self, body_force: Array, prescribed: Array, held: Mask | None = None) -> tuple[Array, StepTimes]:
        with self._making:
            if self._system.solver == "from_scratch":
                self._matrices = self._solver = None
            clock = [time.perf_counter()]
            matrices = self._matrices = self._matrices or assemble(self._system)
            clock.append(time.perf_counter())
            solver = self._solver = self._solver or self._new_solver(matrices)
            clock.append(time.perf_counter())
        given = np.broadcast_to(self._system.pinned[:, None], prescribed.shape)
        if held is not None:
            given, held = given | held, held[self._free].ravel()
        displacement = np.where(given, prescribed, 0.0)
        load = matrices.mass @ body_force
        if displacement.any():
            load -= (matrices.stiffness @ displacement.ravel()).reshape(-1, 3)
        clock.append(time.perf_counter())
        found, iterations = solver.solve(matrices.free, load[self._free].ravel(), self._system.tolerance, held)
        displacement[self._free] += found.reshape(-1, 3)
        clock.append(time.perf_counter())
        return displacement, StepTimes.between(clock, iterations)

    def _new_solver(self, matrices: Matrices) -> Solver:
        points = self._system.points[self._free]
        if self._system.solver == "multigrid":
            return Multigrid(matrices.free, _rigid_motions(points))
        return Factor(matrices.free, points) if self._system.solver == "direct" else Jacobi(matrices.free)


def _rigid_motions(points: Array) -> Array:
    """Three translations and three rotations, one a column, that multigrid has to carry to its coarse levels."""
    relative = (points - points.mean(axis=0)) / np.ptp(points, axis=0).max()
    motions = np.zeros((len(points), 3, 6))
    for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
        motions[:, axis, axis] = 1
        motions[:, b, 3 + axis], motions[:, a, 3 + axis] = relative[:, a], -relative[:, b]
    return motions.reshape(-1, 6)

"""Solvers of one sparse, symmetric, positive definite matrix for many right-hand sides.

Each is a preconditioner that is made once. Components held in addition to those the
matrix leaves out are projected away, so the preconditioner also serves them.
"""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _memory
from .._extras import present, require
from .dissection import nested_dissection

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MOST_ITERATIONS = 5000
_RESIDUAL_LIMIT = 1e-6
"""Of a factor, relative to the right-hand side."""
# Bytes of a factor are about these times n^(4/3), measured on cubes of 25^3 and 31^3 nodes.
_BYTES_SUPERLU, _BYTES_PARDISO = 450, 210


class Solver(ABC):
    """A preconditioner for a matrix, by itself the inverse where ``exact``."""

    exact = False

    @abstractmethod
    def apply(self, residual: Array) -> Array:
        """Return the preconditioned residual."""

    def solve(self, matrix: Any, right: Array, tolerance: float, held: Mask | None = None) -> tuple[Array, int]:
        """Solve for the components not held, those being zero; return also the iterations taken."""
        if self.exact and held is None:
            return _met(matrix, self.apply(right), right), 0
        return conjugate_gradients(matrix, right, self.apply, tolerance, held)


class Multigrid(Solver):
    """Smoothed aggregation that reproduces the rigid motions (n, 6) on every level."""

    def __init__(self, matrix: Any, rigid_motions: Array) -> None:
        smoother = ("chebyshev", {"degree": 3})
        with _same_chance_every_time():
            hierarchy = require("pyamg").smoothed_aggregation_solver(
                matrix, B=rigid_motions, presmoother=smoother, postsmoother=smoother, max_coarse=30
            )
        self._cycle = hierarchy.aspreconditioner()

    def apply(self, residual: Array) -> Array:
        return self._cycle @ residual


class Factor(Solver):
    """A sparse factor of a matrix over nodes (n, 3): Cholesky's by Pardiso where it is installed, else SuperLU's."""

    exact = True

    def __init__(self, matrix: Any, points: Array) -> None:
        pardiso = present("pypardiso")
        wanted = (_BYTES_PARDISO if pardiso else _BYTES_SUPERLU) * matrix.shape[0] ** (4 / 3)
        advice = "" if pardiso else " (half of that with 'sonospline[direct]')"
        _memory.refuse_beyond(int(wanted), f"solver = 'direct': the factor of {matrix.shape[0]:,} unknowns{advice}")
        self._substitute = self._by_pardiso(matrix) if pardiso else _superlu(matrix, points)

    def apply(self, residual: Array) -> Array:
        return self._substitute(residual)

    def _by_pardiso(self, matrix: Any) -> Callable[[Array], Array]:
        from scipy.sparse import triu

        upper = triu(matrix, format="csr")
        solver = require("pypardiso").PyPardisoSolver(mtype=2)  # symmetric positive definite
        solver.factorize(upper)
        weakref.finalize(self, solver.free_memory, everything=True)  # it does not do so by itself
        return lambda right: solver.solve(upper, right)


class Jacobi(Solver):
    """The diagonal: nothing to set up, many iterations."""

    def __init__(self, matrix: Any) -> None:
        self._inverse = 1 / matrix.diagonal()

    def apply(self, residual: Array) -> Array:
        return self._inverse * residual


def conjugate_gradients(
    matrix: Any, right: Array, precondition: Callable[[Array], Array], tolerance: float, held: Mask | None = None
) -> tuple[Array, int]:
    """Return the solution with zero held components, and the iterations taken.

    Iterates until the residual of the other components is ``tolerance`` times the norm of
    the right-hand side.
    """

    def project(vector: Array) -> Array:
        return vector if held is None else np.where(held, 0.0, vector)

    solution, residual = np.zeros_like(right), project(right)
    goal = tolerance * np.linalg.norm(residual)
    direction, old = np.zeros_like(right), 1.0
    for iteration in range(_MOST_ITERATIONS):
        if np.linalg.norm(residual) <= goal:
            return solution, iteration
        conditioned = project(precondition(residual))
        new = float(residual @ conditioned)
        direction = conditioned + new / old * direction
        ahead = project(matrix @ direction)
        curvature = float(direction @ ahead)
        if not curvature > 0:
            raise RuntimeError(f"conjugate gradients broke down (curvature {curvature:g}); use solver='direct'")
        step = new / curvature
        solution += step * direction
        residual = residual - step * ahead
        old = new
    raise RuntimeError(
        f"conjugate gradients left a residual above {tolerance:g} after {_MOST_ITERATIONS} iterations; "
        "use solver='direct', a lower Poisson's ratio or a larger tolerance"
    )


def _met(matrix: Any, found: Array, right: Array) -> Array:
    """Return a factor's solution where it solves the system; RuntimeError where rounding ate it."""
    missing, wanted = float(np.linalg.norm(matrix @ found - right)), float(np.linalg.norm(right))
    if not missing <= _RESIDUAL_LIMIT * wanted:
        raise RuntimeError(
            f"the factor leaves a residual of {missing / wanted:.1e}: the system is singular to rounding; "
            "use a lower Poisson's ratio or stiffnesses in better proportion"
        )
    return found


@contextmanager
def _same_chance_every_time() -> Iterator[None]:
    """PyAMG draws its first vectors from NumPy's global state: lend it one, so that the same input gives the same."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002


def _superlu(matrix: Any, points: Array) -> Callable[[Array], Array]:
    """Its own orderings, minimum degree, take more than twice the time from 25^3 nodes on."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import splu

    coupled = csr_matrix((np.ones(len(matrix.indices), bool), matrix.indices, matrix.indptr), shape=(len(points),) * 2)
    order = (3 * nested_dissection(points, coupled)[:, None] + np.arange(3)).ravel()
    ordered = matrix.tocsc()[order][:, order]
    factor = splu(ordered, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    back = np.argsort(order)
    return lambda right: factor.solve(right[order])[back]

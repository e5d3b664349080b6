"""The polyharmonic spline: equations (1) to (8). Factor once, solve many times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core, _validate
from .field import KernelField
from .grid import Grid
from .kernels import Biharmonic, Kernel

Array = NDArray[np.float64]

COINCIDENT = 1e-10
"""Points nearer than this, in units of their spread, count as one."""
EPSILON_LIMIT = 0.3
"""The paper's +eps is refused from this fraction of the smallest landmark distance on;
the system is first singular at 0.40 of the spacing of a lattice."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """Shift and scale that bring landmarks to the order of one, whatever their unit."""

    centre: Array
    scale: float

    @classmethod
    def of(cls, points: Array) -> _Frame:
        low, high = points.min(axis=0), points.max(axis=0)
        scale = float((high - low).max()) / 2
        return cls((low + high) / 2, scale if scale > 0 else 1.0)

    def to(self, points: Array) -> Array:
        return (points - self.centre) / self.scale


class PolyharmonicSpline:
    r"""A smooth interpolant of displacements given at landmarks.

    Solves the paper's system, equations (4) to (7), for displacements v instead of target
    positions (the affine part makes the two identical):

    .. math:: \begin{bmatrix} K & R \\ R^T & 0 \end{bmatrix}
              \begin{bmatrix} w \\ a \end{bmatrix} = \begin{bmatrix} v \\ 0 \end{bmatrix},
              \qquad u(x) = a_0 + A x + \sum_j w_j U(\|x - c_j\|)

    The matrix depends on the landmarks alone: it is factored when the object is made, and
    :meth:`solve` then costs O(n^2) for each set of displacements.

    Parameters
    ----------
    points : (n, 3) array_like
        Landmarks, at least four, not all in one plane, no two the same.
    kernel : Kernel, default: Biharmonic()
        U, eq. (3).
    smoothing : float, default: 0.0
        Zero meets every landmark exactly. Above zero has the meaning of SciPy's
        ``RBFInterpolator(smoothing=)``: K - smoothing I for U = r, which regularises.
    paper_epsilon : float, default: 0.0
        Reproduction only: the paper's eps, *added* to the diagonal as printed in eq. (4).
        For U = r this moves the system towards singularity, so it is refused at or above
        0.3 times the smallest landmark distance.

    Raises
    ------
    ValueError
        Too few, coplanar, coincident, NaN or infinite landmarks; a negative smoothing; an
        epsilon that would make the system singular.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> points = np.random.default_rng(0).random((50, 3))
    >>> field = ss.PolyharmonicSpline.fit(points, values=0.1 * points)
    >>> bool(np.allclose(field.displacement([[.5, .5, .5]]), 0.05))   # affine maps are exact
    True
    """

    def __init__(
        self,
        points: ArrayLike,
        *,
        kernel: Kernel | None = None,
        smoothing: float = 0.0,
        paper_epsilon: float = 0.0,
    ) -> None:
        self.points = _validate.points("points", points)
        self.kernel = Biharmonic() if kernel is None else kernel
        smoothing = _validate.number("smoothing", smoothing)
        paper_epsilon = _validate.number("paper_epsilon", paper_epsilon)
        _refuse_degenerate(self.points)
        self._frame = _Frame.of(self.points)
        nearest = _refuse_coincident(self._frame.to(self.points), allowed=smoothing > 0)
        _refuse_singular(paper_epsilon, nearest * self._frame.scale)
        # smoothing s pushes the spectrum away from zero; the paper's eps is +eps whatever the sign
        diagonal = self.kernel.sign * smoothing + paper_epsilon
        from scipy.linalg import lu_factor  # a quarter of a second to import: only where used

        self._factor = lu_factor(self._system(diagonal / self._frame.scale**self.kernel.homogeneity))

    @classmethod
    def fit(
        cls,
        points: ArrayLike,
        values: ArrayLike,
        *,
        kernel: Kernel | None = None,
        smoothing: float = 0.0,
        paper_epsilon: float = 0.0,
        grid: Grid | None = None,
    ) -> KernelField:
        """Return the field that takes ``values`` (n, 3) at ``points`` (n, 3).

        Landmarks given twice with the same value count once; with different values they
        are an error (except where ``smoothing`` allows a compromise).
        """
        points = _validate.points("points", points)
        values = _matching_values(points, values)
        if smoothing == 0 and len(points):
            points, values = _merge_coincident(points, values)
        spline = cls(points, kernel=kernel, smoothing=smoothing, paper_epsilon=paper_epsilon)
        return spline.solve(values, grid=grid)

    def solve(self, values: ArrayLike, *, grid: Grid | None = None) -> KernelField:
        """Return the field that takes ``values`` (n, 3) at the landmarks.

        Parameters
        ----------
        values : (n, 3) array_like
            Displacement of each landmark.
        grid : Grid, optional
            The lattice that ``field.on_grid()`` will use.
        """
        from scipy.linalg import lu_solve

        values = _matching_values(self.points, values)
        solution = lu_solve(self._factor, np.vstack([values, np.zeros((4, 3))]))
        weights, affine = solution[: len(values)], solution[len(values) :]
        scale = self._frame.scale
        return KernelField(
            kernel=self.kernel,
            centres=self.points,
            weights=weights / scale**self.kernel.homogeneity,
            affine=affine / np.array([1.0, scale, scale, scale])[:, None],
            reference=self._frame.centre,
            grid=grid,
        )

    def _system(self, diagonal: float) -> Array:
        """The matrix L of eq. (6), landmarks in the spline's own frame."""
        local = self._frame.to(self.points)
        n = len(local)
        system = np.zeros((n + 4, n + 4))
        system[:n, :n] = self.kernel.matrix(local, local)  # (2), (3)
        system[np.arange(n), np.arange(n)] += diagonal  # (4)
        system[:n, n], system[:n, n + 1 :] = 1.0, local  # (5)
        system[n:, :n] = system[:n, n:].T
        return system


def _matching_values(points: Array, values: ArrayLike) -> Array:
    array = _validate.points("values", values)
    if len(array) != len(points):
        raise ValueError(f"values has {len(array)} rows for {len(points)} points; give one row a landmark")
    return array


def _refuse_degenerate(points: Array) -> None:
    if len(points) < 4:
        raise ValueError(f"points has {len(points)} rows; a spline in 3-D needs at least 4 landmarks")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[2] <= 1e-9 * spread[0]:
        raise ValueError("points all lie in one plane; add a landmark off that plane")


def _nearest_pairs(local: Array) -> tuple[Array, NDArray[np.int64]]:
    """Distance to, and index of, the nearest earlier landmark of each one (infinity for the first)."""
    distance = _core.active.kernel_matrix(0, local, local)
    distance[np.triu_indices(len(local))] = np.inf
    return distance.min(axis=1), distance.argmin(axis=1)


def _refuse_coincident(local: Array, *, allowed: bool) -> float:
    nearest, partner = _nearest_pairs(local)
    closest = int(nearest.argmin())
    if nearest[closest] < COINCIDENT and not allowed:
        raise ValueError(
            f"points {int(partner[closest])} and {closest} coincide; remove one of them or set smoothing above zero"
        )
    return float(nearest[closest])


def _merge_coincident(points: Array, values: Array) -> tuple[Array, Array]:
    nearest, partner = _nearest_pairs(_Frame.of(points).to(points))
    twins = np.flatnonzero(nearest < COINCIDENT)
    for twin in twins:
        if not np.allclose(values[twin], values[partner[twin]], rtol=1e-9, atol=0):
            raise ValueError(
                f"points {partner[twin]} and {twin} coincide but values differ "
                f"({values[partner[twin]].tolist()} and {values[twin].tolist()}); keep one of them"
            )
    keep = np.setdiff1d(np.arange(len(points)), twins)
    return points[keep], values[keep]


def _refuse_singular(epsilon: float, nearest: float) -> None:
    limit = EPSILON_LIMIT * nearest
    if epsilon > 0 and epsilon >= limit:
        raise ValueError(
            f"paper_epsilon = {epsilon:g} is too near to a singular system (limit {limit:.3g}, "
            f"{EPSILON_LIMIT} of the smallest landmark distance); use a smaller one, or smoothing instead"
        )

"""The polyharmonic spline: equations (1) to (8). Factor once, append landmarks, solve many times."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core, _validate
from .anchored import AnchoredSystem
from .field import KernelField
from .grid import Grid
from .kernels import Biharmonic, Kernel

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

COINCIDENT = 1e-10
"""Points nearer than this, in units of their spread, count as one."""
EPSILON_LIMIT = 0.3
"""The paper's +eps is refused from this fraction of the smallest landmark distance on;
the system is first singular at 0.40 of the spacing of a lattice."""
_CHECKED = 16
"""Landmarks whose equation is checked after each solve."""
_RESIDUAL_LIMIT = 1e-9
"""Largest residual of those equations, relative to the values, before everything is factored anew."""


class PolyharmonicSpline:
    r"""A smooth interpolant of displacements given at landmarks.

    Solves the paper's system, equations (4) to (7), for displacements v instead of target
    positions (the affine part makes the two identical):

    .. math:: \begin{bmatrix} K & R \\ R^T & 0 \end{bmatrix}
              \begin{bmatrix} w \\ a \end{bmatrix} = \begin{bmatrix} v \\ 0 \end{bmatrix},
              \qquad u(x) = a_0 + A x + \sum_j w_j U(\|x - c_j\|)

    The matrix depends on the landmarks alone, so it is factored when the object is made,
    extended by :meth:`append`, cut back by :meth:`truncate`, and :meth:`solve` then costs
    O(n^2) for each set of displacements.

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
        points = _validate.points("points", points)
        self.kernel = Biharmonic() if kernel is None else kernel
        self._smoothing = _validate.number("smoothing", smoothing)
        epsilon = _validate.number("paper_epsilon", paper_epsilon)
        _refuse_degenerate(points)
        self._centre = (points.min(axis=0) + points.max(axis=0)) / 2
        self._scale = float(np.ptp(points, axis=0).max()) / 2
        nearest = self._refuse_coincident(np.empty((0, 3)), self._local(points))
        if self.kernel.sign < 0:  # +eps regularises a positive definite kernel
            _refuse_singular(epsilon, nearest * self._scale)
        # smoothing moves the spectrum away from zero; the paper's eps is +eps whatever the sign
        self._diagonal = self._smoothing + self.kernel.sign * epsilon
        self.points = points.copy()
        """(n, 3) landmarks, in the order given and appended."""
        self._first_size = len(points)
        self._base = _spread_out(points)
        self._rest = np.setdiff1d(np.arange(len(points)), self._base)
        self._system = AnchoredSystem(
            self.kernel, self._local(points[self._base]), self._diagonal / self._scale**self.kernel.homogeneity
        )
        self._system.append(self._local(points[self._rest]))

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

    def append(self, points: ArrayLike) -> None:
        """Add landmarks (m, 3) after the present ones, in O(m n^2).

        Raises
        ------
        ValueError
            One of them coincides with another; the spline is then as it was.
        """
        new = _validate.points("points", points)
        local = self._local(new)
        self._refuse_coincident(self._local(self.points), local)
        self._system.append(local)
        self._rest = np.concatenate([self._rest, np.arange(len(self.points), len(self.points) + len(new))])
        self.points = np.concatenate([self.points, new])

    def truncate(self, size: int) -> None:
        """Drop the landmarks from number ``size`` on; those given at the start always stay."""
        if not self._first_size <= size <= len(self.points):
            raise ValueError(f"size = {size} is out of range; give {self._first_size} to {len(self.points)}")
        self._system.truncate(size - 4)
        self._rest = self._rest[: size - 4]
        self.points = self.points[:size]

    def solve(self, values: ArrayLike, *, grid: Grid | None = None) -> KernelField:
        """Return the field that takes ``values`` (n, 3) at the landmarks.

        Parameters
        ----------
        values : (n, 3) array_like
            Displacement of each landmark.
        grid : Grid, optional
            The lattice that ``field.on_grid()`` will use.
        """
        values = _matching_values(self.points, values)
        field = self._solve(values, grid)
        residual = self._residual(field, values)
        if residual > _RESIDUAL_LIMIT:
            logger.warning("residual %.1e: factoring all %d landmarks anew", residual, len(self.points))
            self._system.refactor()
            field = self._solve(values, grid)
        return field

    def _solve(self, values: Array, grid: Grid | None) -> KernelField:
        solution = self._system.solve(values[self._base], values[self._rest])
        weights = np.empty_like(values)
        weights[self._base], weights[self._rest] = solution.corner_weights, solution.weights
        scale = self._scale
        return KernelField(
            kernel=self.kernel,
            centres=self.points,
            weights=weights / scale**self.kernel.homogeneity,
            affine=solution.affine / np.array([1.0, scale, scale, scale])[:, None],
            reference=self._centre,
            grid=grid,
        )

    def _residual(self, field: KernelField, values: Array) -> float:
        """How far some landmarks are from their values, relative to the largest value."""
        largest = float(np.abs(values).max())
        if largest == 0:
            return 0.0
        checked = np.unique(np.linspace(0, len(self.points) - 1, _CHECKED).astype(int))
        met = field.displacement(self.points[checked])
        met += self.kernel.sign * self._diagonal * field.weights[checked]
        return float(np.abs(met - values[checked]).max()) / largest

    def _local(self, points: Array) -> Array:
        """Landmarks in units of their own spread, so that no unit of length matters."""
        return (points - self._centre) / self._scale

    def _refuse_coincident(self, old: Array, new: Array) -> float:
        """Return the smallest distance of new landmarks from one another and from old ones."""
        distance, i, j = _closest_pair(old, new)
        if distance < COINCIDENT and self._smoothing == 0:
            raise ValueError(f"points {j} and {i} coincide; remove one of them or set smoothing above zero")
        return distance


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


def _spread_out(points: Array) -> NDArray[np.int64]:
    """Four landmarks far from one another: the farthest, then those that widen line, plane and body most."""
    first = int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    chosen, left = [first], points - points[first]
    for _ in range(3):
        size = np.linalg.norm(left, axis=1)
        chosen.append(int(np.argmax(size)))
        axis = left[chosen[-1]] / size[chosen[-1]]
        left = left - np.outer(left @ axis, axis)
    return np.array(chosen)


def _earlier_distances(old: Array, new: Array) -> Array:
    """Distance of each new landmark from all before it, (m, n + m); infinity from itself on."""
    distance = _core.active.kernel_matrix(0, new, np.concatenate([old, new]))
    corner = distance[:, len(old) :]
    corner[np.triu(np.ones(corner.shape, bool))] = np.inf
    return distance


def _closest_pair(old: Array, new: Array) -> tuple[float, int, int]:
    """Smallest distance of a new landmark from an earlier one, and the two numbers."""
    distance = _earlier_distances(old, new)
    if distance.size == 0:
        return np.inf, 0, 0
    i, j = np.unravel_index(int(distance.argmin()), distance.shape)
    return float(distance[i, j]), len(old) + int(i), int(j)


def _merge_coincident(points: Array, values: Array) -> tuple[Array, Array]:
    spread = float(np.ptp(points, axis=0).max()) or 1.0
    distance = _earlier_distances(np.empty((0, 3)), (points - points[0]) / (spread / 2))
    twins, partners = np.nonzero(distance < COINCIDENT)
    for twin, partner in zip(twins, partners, strict=True):
        if not np.allclose(values[twin], values[partner], rtol=1e-9, atol=0):
            raise ValueError(
                f"points {partner} and {twin} coincide but values differ "
                f"({values[partner].tolist()} and {values[twin].tolist()}); keep one of them"
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

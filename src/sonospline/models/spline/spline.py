"""The polyharmonic spline: equations (1) to (8). Factor once, append landmarks, solve many times."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import _core, _validate
from ...fields.kernel import Kernel
from ...fields.kernel_field import KernelField
from ...fields.polyharmonic import Biharmonic
from ...geometry.grid import Grid
from ...geometry.tissue import Tissue
from .anchored import AnchoredSystem, Base, CornerBase
from .faces import FaceBase, Progress

Array = NDArray[np.float64]
Index = NDArray[np.int64]

logger = logging.getLogger(__name__)

COINCIDENT = 1e-10
"""Points nearer than this, in units of their spread, count as one."""
EPSILON_LIMIT = 0.3
"""The paper's +eps is refused from this fraction of the smallest landmark distance on;
the system is first singular at 0.40 of the spacing of a lattice."""
_RESIDUAL_LIMIT = 1e-9
"""Largest residual of those equations, relative to the values, before everything is factored at once."""
_ERROR_LIMIT = 1e-6
"""Largest residual after that: beyond it the landmarks are not met, and the field is worth nothing."""
_MOST_SMOOTHING = 1e6
"""In the kernel's value across half the landmarks' spread."""
_SCALES = 1e-60, 1e60
"""Units of length whose cubes are numbers."""


@dataclass(frozen=True, eq=False)
class UnitCoordinates:
    """Coordinates in which landmarks are of the order of one, so that no unit of length matters."""

    centre: Array
    scale: float
    axes: Array
    """Columns are the axes in the world."""

    @classmethod
    def around(cls, points: Array) -> UnitCoordinates:
        """Return those of a set of landmarks."""
        low, high = points.min(axis=0), points.max(axis=0)
        scale = float((high / 2 - low / 2).max())
        if not _SCALES[0] < scale < _SCALES[1]:
            raise ValueError(
                f"points spread over {scale:.3g} on either side; give different ones, in a unit of about their own size"
            )
        return cls(low / 2 + high / 2, scale, np.eye(3))

    @classmethod
    def of_grid(cls, grid: Grid) -> UnitCoordinates:
        """Return those of a grid, along its axes from its middle."""
        return cls(grid.world(grid.extent / 2), float(grid.extent.max()) / 2, grid.direction)

    def local(self, points: Array) -> Array:
        """Return world points (m, 3) in these coordinates."""
        return (points - self.centre) @ self.axes / self.scale

    def world_affine(self, affine: Array) -> Array:
        """Return an affine map (4, 3) of these coordinates as one of world offsets from the centre."""
        world = affine.copy()
        world[1:] = self.axes @ affine[1:] / self.scale
        return world

    def diagonal(self, value: float, kernel: Kernel) -> float:
        """Return a number on the kernel matrix's diagonal in these units."""
        return value / self.scale**kernel.homogeneity


class CoincidentError(ValueError):
    """Two landmarks are one; the message names them."""


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
        kernel = Biharmonic() if kernel is None else kernel
        smoothing = _validate.number("smoothing", smoothing)
        epsilon = _validate.number("paper_epsilon", paper_epsilon)
        _refuse_too_few(points)
        unit = UnitCoordinates.around(points)
        _refuse_flat(unit.local(points))
        if epsilon > 0 and kernel.sign < 0:  # +eps regularises a positive definite kernel
            _refuse_singular(epsilon, _closest_pair(points, since=0)[0])
        # smoothing moves the spectrum away from zero; the paper's eps is +eps whatever the sign
        diagonal = smoothing + kernel.sign * epsilon
        _refuse_smoothing(smoothing, unit, kernel)
        corners = _spread_out(points)
        try:
            base = CornerBase(kernel, unit.local(points[corners]), unit.diagonal(diagonal, kernel))
        except np.linalg.LinAlgError:
            raise ValueError(_uneven(points)) from None
        others = np.setdiff1d(np.arange(len(points)), corners)
        self._begin(kernel, diagonal, unit, base, points.copy(), np.concatenate([corners, others]))
        self._factor(points[others], self.points, since=0)

    def __repr__(self) -> str:
        return f"PolyharmonicSpline({len(self.points)} landmarks, {type(self.kernel).__name__})"

    @classmethod
    def pinning_faces(
        cls,
        tissue: Tissue,
        *,
        kernel: Kernel | None = None,
        smoothing: float = 0.0,
        progress: Progress | None = None,
    ) -> PolyharmonicSpline:
        """Return a spline whose first landmarks are all nodes of the tissue's pinned faces.

        Their matrix is factored once for a grid and kept on disk, in the folder that
        ``SONOSPLINE_CACHE`` names or the user's cache folder; ``progress(done, of)`` is called.
        """
        kernel = Biharmonic() if kernel is None else kernel
        smoothing = _validate.number("smoothing", smoothing)
        unit = UnitCoordinates.of_grid(tissue.grid)
        _refuse_smoothing(smoothing, unit, kernel)
        base = FaceBase(tissue, kernel, unit.scale, diagonal=unit.diagonal(smoothing, kernel), progress=progress)
        points = tissue.grid.node(np.argwhere(tissue.pinned))  # in the order of the base
        spline = cls.__new__(cls)
        spline._begin(kernel, smoothing, unit, base, points, np.arange(len(points)))
        return spline

    def _begin(
        self,
        kernel: Kernel,
        diagonal: float,
        unit: UnitCoordinates,
        base: Base,
        points: Array,
        order: Index,
    ) -> None:
        """Start from the landmarks given first: their points, and ``order``, which takes them base first."""
        self.kernel = kernel
        self._diagonal = diagonal
        self._unit = unit
        self._order = order
        self._place = np.argsort(order)  # the inverse of order
        self._system = AnchoredSystem(kernel, base, unit.diagonal(diagonal, kernel))
        self.points = points
        """(n, 3) landmarks, in the order given and appended."""
        self._first_size = len(points)

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
        make = partial(cls, kernel=kernel, smoothing=smoothing, paper_epsilon=paper_epsilon)
        try:
            spline = make(points)
        except CoincidentError:
            points, values = _merge_coincident(points, values)
            spline = make(points)
        return spline.solve(values, grid=grid)

    def append(self, points: ArrayLike) -> None:
        """Add landmarks (m, 3) after the present ones, in O(m n^2).

        Raises
        ------
        ValueError
            One of them coincides with another; the spline is then as it was.
        """
        new = _validate.points("points", points)
        together = np.concatenate([self.points, new])
        self._factor(new, together, since=len(self.points))
        self.points = together

    def _factor(self, new: Array, together: Array, *, since: int) -> None:
        try:
            self._system.append(self._unit.local(new))
        except np.linalg.LinAlgError:
            _, i, j = _closest_pair(together, since=since)
            raise CoincidentError(
                f"points {j} and {i} coincide; remove one of them or set smoothing above zero"
            ) from None

    def reserve(self, size: int) -> None:
        """Make room for ``size`` landmarks in all, so that no later append has to."""
        self._system.reserve(size - self._system.base_size)

    def truncate(self, size: int) -> None:
        """Drop the landmarks from number ``size`` on; those given at the start always stay."""
        if not self._first_size <= size <= len(self.points):
            raise ValueError(f"size = {size} is out of range; give {self._first_size} to {len(self.points)}")
        self._system.truncate(size - self._system.base_size)
        self.points = self.points[:size]

    def solve(self, values: ArrayLike, *, grid: Grid | None = None) -> KernelField:
        """Return the field that takes ``values`` (n, 3) at the landmarks.

        Parameters
        ----------
        values : (n, 3) array_like
            Displacement of each landmark. With fewer rows than landmarks, the last
            landmarks are left out: they constrain nothing.
        grid : Grid, optional
            The lattice that ``field.on_grid()`` will use.
        """
        values = _validate.points("values", values)
        if not self._first_size <= len(values) <= len(self.points):
            raise ValueError(
                f"values has {len(values)} rows for {len(self.points)} landmarks; give one row a landmark "
                f"(at least for the first {self._first_size})"
            )
        ordered = self._first(values, self._order)
        at_base, others = ordered[: self._system.base_size], ordered[self._system.base_size :]
        solution = self._system.solve(at_base, others)
        residual = self._system.residual(solution, others)
        if not residual <= _RESIDUAL_LIMIT:
            logger.warning("residual %.1e: factoring %d landmarks at once", residual, len(values))
            # The factor in use stays as it is: answers must not depend on what was asked before.
            at_once = self._system.at_once(len(others))
            solution = at_once.solve(at_base, others)
            residual = at_once.residual(solution, others)
            if not residual <= _ERROR_LIMIT:
                raise ValueError(f"{_uneven(self.points)} (residual {residual:.1e})")
        weights = np.concatenate([solution.base_weights, solution.weights])
        weights /= self._unit.scale**self.kernel.homogeneity
        return KernelField(
            kernel=self.kernel,
            centres=self.points[: len(values)],
            weights=self._first(weights, self._place),
            affine=self._unit.world_affine(solution.affine),
            reference=self._unit.centre,
            grid=grid,
        )

    def _first(self, rows: Array, order: Index) -> Array:
        """Reorder the rows of the landmarks given at the start; the others follow as they are."""
        return np.concatenate([rows.take(order, axis=0), rows[len(order) :]])


def _matching_values(points: Array, values: ArrayLike) -> Array:
    array = _validate.points("values", values)
    if len(array) != len(points):
        raise ValueError(f"values has {len(array)} rows for {len(points)} points; give one row a landmark")
    return array


def _refuse_smoothing(smoothing: float, unit: UnitCoordinates, kernel: Kernel) -> None:
    most = _MOST_SMOOTHING * unit.scale**kernel.homogeneity
    if smoothing > most:
        raise ValueError(f"smoothing = {smoothing:g} leaves only an affine map of the values; give at most {most:.3g}")


def _refuse_too_few(points: Array) -> None:
    if len(points) < 4:
        raise ValueError(f"points has {len(points)} rows; a spline in 3-D needs at least 4 landmarks")


def _refuse_flat(points: Array) -> None:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[2] <= 1e-9 * spread[0]:
        raise ValueError("points all lie in one plane; add a landmark off that plane")


def _spread_out(points: Array) -> Index:
    """Four landmarks far from one another: the farthest, then those that widen line, plane and body most."""
    first = int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    chosen, left = [first], points - points[first]
    for _ in range(3):
        size = np.linalg.norm(left, axis=1)
        chosen.append(int(np.argmax(size)))
        axis = left[chosen[-1]] / size[chosen[-1]]
        left = left - np.outer(left @ axis, axis)
    return np.array(chosen)


def _uneven(points: Array) -> str:
    distance, i, j = _closest_pair(points, since=0)
    return (
        f"points spread over {np.ptp(points, axis=0).max():.3g}, but points {j} and {i} are {distance:.1e} apart: too "
        "uneven for double precision; remove outliers, or one of such pairs"
    )


def _earlier_distances(points: Array, *, since: int) -> Array:
    """Distance (n - since, n) of the landmarks from number ``since`` on to those before; infinity elsewhere."""
    distance = _core.active.kernel_matrix(0, points[since:], points)
    distance[:, since:][np.triu(np.ones((len(distance),) * 2, bool))] = np.inf
    return distance


def _closest_pair(points: Array, *, since: int) -> tuple[float, int, int]:
    """Smallest distance of a landmark from number ``since`` on to an earlier one; the numbers of the two."""
    distance = _earlier_distances(points, since=since)
    i, j = np.unravel_index(int(distance.argmin()), distance.shape)
    return float(distance[i, j]), since + int(i), int(j)


def _merge_coincident(points: Array, values: Array) -> tuple[Array, Array]:
    spread = float(np.ptp(points, axis=0).max()) or 1.0
    distance = _earlier_distances((points - points[0]) / (spread / 2), since=0)
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

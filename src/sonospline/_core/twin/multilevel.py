"""NumPy twin of the multilevel sum: the same algorithm and results as the compiled one, slower.

``u(x) = affine[0] + x @ affine[1:] + sum_j weights[j] |x - c_j|`` on all nodes of a lattice, for
landmarks c_j on its nodes. The direct sum is taken on a lattice ``2**depth`` times coarser
(with ghost nodes around), then interpolated up level by level. What interpolation misses
near a landmark depends only on where the landmark lies relative to the coarse nodes, its
parity class: one table a class holds it, and is added for each landmark.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .checks import numbered, require, require_spacing, same_length

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Triple = tuple[int, int, int]

MAX_REACH = 28
RUN = 16  # tables keep whole runs of nodes along z
ORDERS = (4, 6, 8, 10, 12)
MAX_LEVELS = 3

# Costs in nanoseconds, as far as they decide between depths.
_PAIR, _CORRECTION, _NODE = 10.0, 1e5, 300.0


def midpoint_stencil(order: int) -> Array:
    """Weights of polynomial interpolation midway between ``order`` equidistant nodes."""
    nodes = np.arange(order) - (order - 1) / 2
    gaps = nodes[:, None] - nodes + np.eye(order)
    weights: Array = np.array([np.delete(-nodes, i).prod() for i in range(order)]) / gaps.prod(axis=1)
    return weights


def amplification(order: int) -> float:
    """Largest amplification of an error by interpolation along the three axes."""
    return float(np.abs(midpoint_stencil(order)).sum() ** 3)


class Lattice(NamedTuple):
    """Nodes ``low`` to ``high`` of one level, both included, ghosts among them."""

    low: Triple
    high: Triple

    def coarser(self, order: int) -> Lattice:
        """The lattice of twice the spacing that interpolation onto this one reads."""
        half = order // 2
        low = tuple(n // 2 - (half - 1) for n in self.low)
        high = tuple((n - 1) // 2 + half for n in self.high)
        return Lattice(low, high)  # type: ignore[arg-type]

    def axis(self, a: int) -> Index:
        return np.arange(self.low[a], self.high[a] + 1)

    @property
    def nodes(self) -> int:
        return int(np.prod([h - n + 1 for n, h in zip(self.low, self.high, strict=True)]))


def _interpolation(fine: Index, coarse: Index, order: int) -> Array:
    """Matrix (fine, coarse): even nodes are coarse nodes, odd ones lie midway."""
    matrix = np.zeros((len(fine), len(coarse)))
    stencil = midpoint_stencil(order)
    for row, node in zip(matrix, fine, strict=True):
        if node % 2:
            first = node // 2 - (order // 2 - 1) - coarse[0]
            row[first : first + order] = stencil
        else:
            row[node // 2 - coarse[0]] = 1.0
    return matrix


def _refine(values: Array, matrices: list[Array]) -> Array:
    """Apply one matrix along each of the first three axes."""
    for a, matrix in enumerate(matrices):
        values = np.moveaxis(np.tensordot(matrix, values, (1, a)), 0, a)
    return values


def _distances(axes: list[Array]) -> Array:
    x, y, z = axes
    return np.sqrt(x[:, None, None] ** 2 + y[:, None] ** 2 + z**2)


class _Level:
    """Interpolation to one lattice, and the corrections by parity class."""

    def __init__(self, level: int, order: int, ratio: Array, cutoff: float) -> None:
        self.level, self.order, self.ratio, self.cutoff = level, order, ratio, cutoff
        self.period = 2 << level

    @cached_property
    def tables(self) -> dict[Triple, Array]:
        """Corrections on even nodes -reach to reach + 1 of each class; empty where they never die out."""
        classes: list[Triple] = list(product(range(self.period), repeat=3))  # type: ignore[arg-type]
        for reach in range(self.order + 2, MAX_REACH + 1, 2):
            tables = {}
            for landmark in classes:
                block = self._block(landmark, reach)
                inner = np.zeros(block.shape, bool)
                inner[2:-2, 2:-2, 2:-2] = True
                if (np.abs(block[~inner]) > self.cutoff).any():
                    break
                tables[landmark] = np.where(self._kept(block), block, 0.0)
            else:
                return tables
        return {}

    def _block(self, landmark: Triple, reach: int) -> Array:
        """U minus its interpolant around a landmark, in spacings of level 0 along x."""
        step = 1 << self.level
        fine = np.arange(-reach, reach + 2)
        coarse = np.arange(-reach // 2 - (self.order // 2 - 1), reach // 2 + self.order // 2 + 1)
        at = [[(n * step - c) * r for c, r in zip(landmark, self.ratio, strict=True)] for n in (fine, 2 * coarse)]
        return _distances(at[0]) - _refine(_distances(at[1]), [_interpolation(fine, coarse, self.order)] * 3)

    def _kept(self, block: Array) -> NDArray[np.bool_]:
        """Whole runs along z, each from a value above the cutoff on."""
        left = np.abs(block) > self.cutoff
        kept = np.zeros(block.shape, bool)
        for z in range(block.shape[2]):
            starts = left[..., z].copy()[..., None]
            kept[..., z : z + RUN] |= starts
            left[..., z : z + RUN] &= ~starts
        return kept

    def correct(self, values: Array, lattice: Lattice, index: Index, weights: Array) -> None:
        """Add every landmark's corrections to ``values`` (nx, ny, nz, 3) in place."""
        even = index // self.period * 2 - np.array(lattice.low)
        for base, landmark, weight in zip(even, index % self.period, weights, strict=True):
            table = self.tables[tuple(landmark)]
            first = base - (table.shape[0] // 2 - 1)
            low = np.maximum(first, 0)
            high = np.maximum(np.minimum(first + table.shape, values.shape[:3]), low)
            inside = tuple(slice(*pair) for pair in zip(low, high, strict=True))
            part = tuple(slice(*pair) for pair in zip(low - first, high - first, strict=True))
            values[inside] += table[part][..., None] * weight


class MultilevelPlan:
    """A multilevel sum of U = r on one lattice, for any landmarks on its nodes.

    Parameters
    ----------
    shape : (int, int, int)
        Nodes of the lattice.
    spacing : (float, float, float)
        Their distances along each axis.
    tolerance : float, default: 3e-5
        Corrections at or below it, per unit weight and in the unit of ``spacing``, are
        dropped. The error is at most ``error_per_weight(depth)`` times the sum of |weights|,
        rounding aside, and typically a fortieth of it.
    orders : tuple of int, default: (6, 8, 8)
        Even number of nodes that interpolation reads, finest level first; at most 3 levels.

    Raises
    ------
    ValueError
        Orders that are not offered, or corrections that do not die out within 28 nodes:
        a spacing too anisotropic, or a tolerance too small for the orders.
    """

    def __init__(
        self,
        shape: Triple,
        spacing: tuple[float, float, float],
        tolerance: float = 3e-5,
        orders: tuple[int, ...] = (6, 8, 8),
    ) -> None:
        if not 1 <= len(orders) <= MAX_LEVELS or any(order not in ORDERS for order in orders):
            raise ValueError("orders is not 1 to 3 of 4, 6, 8, 10 and 12")
        require(numbered(shape, 1), "shape has no node along an axis, or too many")
        require_spacing(spacing)
        require(np.isfinite(tolerance) and tolerance > 0, "tolerance is not above 0")
        self._shape, self._spacing, self._tolerance = tuple(shape), np.asarray(spacing, float), tolerance
        ratio = self._spacing / self._spacing[0]
        self._levels = [_Level(i, p, ratio, tolerance / self._spacing[0]) for i, p in enumerate(orders)]
        self._lattices = [Lattice((0, 0, 0), tuple(n - 1 for n in shape))]  # type: ignore[arg-type]
        for order in orders:
            self._lattices.append(self._lattices[-1].coarser(order))
        self._prepare(1)
        if not self._levels:
            raise ValueError("spacing is too anisotropic, or tolerance too small, for a multilevel sum")

    @property
    def max_depth(self) -> int:
        """Levels there are."""
        return len(self._levels)

    def depth(self, centres: int) -> int:
        """Return the levels that are fastest for so many landmarks; 0 where the direct sum is."""
        costs = [centres * _PAIR * self._lattices[0].nodes]
        for d in range(1, self.max_depth + 1):
            nodes = sum(lattice.nodes for lattice in self._lattices[:d])
            costs.append(centres * (_PAIR * self._lattices[d].nodes + d * _CORRECTION) + nodes * _NODE)
        best = int(np.argmin(costs))
        self._prepare(best)
        return min(best, self.max_depth)

    def error_per_weight(self, depth: int) -> float:
        """Return the bound of the error over the sum of |weights|, rounding aside."""
        require(0 <= depth <= self.max_depth, "depth is not between 0 and max_depth")
        factors = [amplification(level.order) for level in self._levels[: depth - 1]]
        return float(self._tolerance * np.cumprod([1.0, *factors]).sum()) if depth else 0.0

    def evaluate(
        self,
        centre_index: Index,
        weights: Array,
        affine: Array,
        depth: int = 0,
        out: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """Return u as (nx, ny, nz, 3).

        Parameters
        ----------
        centre_index : (n, 3) ndarray
            Landmarks by lattice index.
        weights : (n, 3) ndarray
            Their weights.
        affine : (4, 3) ndarray
            a0, then the rows that multiply x, y, z; node (0, 0, 0) is the origin.
        depth : int, default: 0
            Levels; 0 takes the fastest number, at least 1.
        out : (nx, ny, nz, 3) float32 ndarray, optional
            Filled and returned instead of a new array.
        """
        same_length("centre_index", centre_index, "weights", weights)
        if (centre_index < 0).any() or (centre_index >= self._shape).any():
            raise ValueError("centre_index has a node outside the lattice")
        if out is not None and out.shape != (*self._shape, 3):
            raise ValueError("out is not of the plan's shape")
        depth = depth or max(self.depth(len(weights)), 1)
        self._prepare(depth)
        if not 1 <= depth <= self.max_depth:
            raise ValueError("depth is not between 1 and max_depth")
        values = self._direct(depth, centre_index, weights, affine)
        for level in range(depth - 1, -1, -1):
            coarse, fine = self._lattices[level + 1], self._lattices[level]
            order = self._levels[level].order
            values = _refine(values, [_interpolation(fine.axis(a), coarse.axis(a), order) for a in range(3)])
            self._levels[level].correct(values, fine, centre_index, weights * self._spacing[0])
        if out is None:
            return values.astype(np.float32)
        out[...] = values
        return out

    def _direct(self, depth: int, index: Index, weights: Array, affine: Array) -> Array:
        lattice, step = self._lattices[depth], 1 << depth
        axes = [lattice.axis(a) * step * self._spacing[a] for a in range(3)]
        values: Array = affine[0] + np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) @ affine[1:]
        for centre, weight in zip(index * self._spacing, weights, strict=True):
            values += _distances([x - c for x, c in zip(axes, centre, strict=True)])[..., None] * weight
        return values

    def _prepare(self, depth: int) -> None:
        """Build the tables of ``depth`` levels; forget the levels that have none."""
        for level in range(min(depth, self.max_depth)):
            if not self._levels[level].tables:
                del self._levels[level:]
                return

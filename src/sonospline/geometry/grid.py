"""The node lattice: where the tissue's points are, in world coordinates (RAS, mm)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _memory, _validate
from .._by_value import ByValue
from .._shown import lengths, place, shown, size

Array = NDArray[np.float64]

FACES = ("x-", "x+", "y-", "y+", "z-", "z+")
"""Faces of a grid: lattice axis, then the side of its first (-) or last (+) node."""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Grid(ByValue):
    """A regular lattice of nodes with a position and an orientation in the world.

    The paper's mesh of points zeta_s, uniformly spaced by k (Sec. II). World coordinates
    are right-handed RAS in millimetres; the paper's unit cube is a grid of side 1, with
    no special case anywhere.

    Parameters
    ----------
    shape : (int, int, int)
        Nodes along each lattice axis, at least 2.
    spacing : (float, float, float) or float
        Distance between neighbouring nodes along each axis, in world units (mm).
    origin : (3,) array_like, default: (0, 0, 0)
        World position of node (0, 0, 0).
    direction : (3, 3) array_like, default: identity
        Columns are the unit vectors of the lattice axes in the world; orthonormal.

    Raises
    ------
    ValueError
        A size below 2, a spacing that is not above zero, or a direction matrix that is
        not orthonormal.

    Examples
    --------
    >>> import sonospline as ss
    >>> grid = ss.Grid.unit_cube(25)
    >>> grid.node_count, grid.side
    (15625, 1.0)
    >>> grid, grid == ss.Grid.unit_cube(25)
    (Grid(25 x 25 x 25, 0.04167 mm), True)
    """

    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    origin: Array
    direction: Array

    def __init__(
        self,
        *,
        shape: Sequence[int],
        spacing: float | Sequence[float] | Array,
        origin: ArrayLike = (0, 0, 0),
        direction: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ) -> None:
        if np.shape(shape) != (3,):
            raise ValueError(f"shape = {shown(shape)} is not three whole numbers; give nodes along x, y, z")
        sides = np.ravel(spacing)
        if sides.size not in (1, 3):
            raise ValueError(f"spacing = {shown(spacing)} is not one or three numbers; give mm along x, y, z")
        set_ = object.__setattr__
        set_(self, "shape", tuple(_validate.count("shape", n, least=2) for n in shape))
        set_(self, "spacing", tuple(_validate.number("spacing", h, positive=True) for h in np.broadcast_to(sides, 3)))
        set_(self, "origin", _validate.vector("origin", origin))
        set_(self, "direction", _orthonormal(direction))

    def __repr__(self) -> str:
        at = f", origin {place(self.origin)}" if self.origin.any() else ""
        turned = "" if self.upright else ", tilted"
        return f"Grid({size(self.shape)}, {lengths(self.spacing)}{at}{turned})"

    @classmethod
    def unit_cube(cls, nodes: int) -> Grid:
        """Return the paper's normalised cube [0, 1]^3 with ``nodes`` nodes a side (Sec. IV)."""
        nodes = _validate.count("nodes", nodes, least=2)
        return cls(shape=(nodes,) * 3, spacing=(1 / (nodes - 1),) * 3)

    @classmethod
    def covering(
        cls,
        extent: ArrayLike,
        *,
        nodes: int = 150_000,
        origin: ArrayLike = (0, 0, 0),
        direction: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ) -> Grid:
        """Return a grid of about ``nodes`` nodes, nearly cubic cells, over a box.

        Parameters
        ----------
        extent : (3,) array_like
            Side lengths of the box in mm, from first to last node.
        nodes : int, default: 150000
            Nodes wanted in all; the grid's own ``node_count`` is exact.
        origin, direction : array_like
            As for :class:`Grid`.

        Examples
        --------
        >>> import sonospline as ss
        >>> ss.Grid.covering((100, 50, 25), nodes=1000).shape
        (19, 10, 5)
        """
        sides = _validate.vector("extent", extent)
        if (sides <= 0).any():
            raise ValueError(f"extent = {sides.tolist()} is not above zero along every axis; give a box in mm")
        _validate.count("nodes", nodes, least=8)
        shape = _balanced_shape(sides, nodes)
        return cls(
            shape=shape,
            spacing=sides / (np.array(shape) - 1),
            origin=origin,
            direction=direction,
        )

    @property
    def node_count(self) -> int:
        """Number of nodes N."""
        return prod(self.shape)

    @cached_property
    def extent(self) -> Array:
        """(3,) side lengths, first to last node, in mm."""
        return (np.array(self.shape) - 1) * self.spacing

    @property
    def side(self) -> float:
        """The shortest side in mm: what "cube side" means for a box that is no cube."""
        return float(self.extent.min())

    @cached_property
    def upright(self) -> bool:
        """Whether the lattice axes are those of the world."""
        return bool(np.array_equal(self.direction, np.eye(3)))

    @cached_property
    def points(self) -> Array:
        """(N, 3) world positions of the nodes, z fastest."""
        _memory.refuse_beyond(100 * self.node_count, f"grid = {self.shape}: the positions of its nodes")
        index = np.indices(self.shape, dtype=np.int32).reshape(3, -1).T
        return self.world(index * np.array(self.spacing))

    def local(self, points: ArrayLike) -> Array:
        """Return world points (m, 3), or one (3,), in the lattice's coordinates: mm along each axis from node 0."""
        return np.ascontiguousarray((np.asarray(points, float) - self.origin) @ self.direction)

    def world(self, local: ArrayLike) -> Array:
        """Return positions along the lattice (m, 3), or one (3,), as world points; inverse of :meth:`local`."""
        return np.asarray(local, float) @ self.direction.T + self.origin

    def node(self, index: ArrayLike) -> Array:
        """Return world positions (m, 3) of nodes given by lattice index (m, 3); (3,) of one."""
        return self.world(np.asarray(index) * np.array(self.spacing))

    def contains(self, points: ArrayLike, *, tolerance: float = 1e-9) -> NDArray[np.bool_]:
        """Return which world points (m, 3) lie in the box, to ``tolerance`` box sides; one answer for one point."""
        local = self.local(points)
        slack = tolerance * self.extent.max()
        return ((local >= -slack) & (local <= self.extent + slack)).all(axis=-1)

    def nearest_face(self, point: ArrayLike) -> str:
        """Return the face (one of :data:`FACES`) that lies nearest to a world point."""
        local = self.local(_validate.vector("point", point))
        return FACES[int(np.argmin(np.abs(np.stack([local, self.extent - local], axis=1))))]

    def on_faces(self, faces: tuple[str, ...]) -> NDArray[np.bool_]:
        """Return a mask of shape ``shape``: which nodes lie on any of the given faces."""
        _memory.refuse_beyond(self.node_count, f"grid = {self.shape}: a mask of its nodes")
        mask = np.zeros(self.shape, bool)
        for face in faces:
            mask[face_slice(face)] = True
        return mask


def face_slice(face: str) -> tuple[slice | int, ...]:
    """Return the index that selects a face's nodes from an array shaped like the grid."""
    axis, end = divmod(FACES.index(_validate.choice("face", face, FACES)), 2)
    index: list[slice | int] = [slice(None)] * 3
    index[axis] = -1 if end else 0
    return tuple(index)


def _orthonormal(direction: ArrayLike) -> Array:
    """The matrix, freed of the rounding that image headers carry."""
    try:
        matrix = np.array(direction, float)
    except (TypeError, ValueError):
        raise ValueError(f"direction = {shown(direction)} is not numeric; give a 3 x 3 matrix") from None
    if matrix.shape != (3, 3) or not np.allclose(matrix.T @ matrix, np.eye(3), atol=1e-4):
        raise ValueError(f"direction = {shown(matrix.tolist())} is not orthonormal; give unit axes as columns")
    left, _, right = np.linalg.svd(matrix)
    turned = left @ right
    turned.setflags(write=False)
    return turned


def _balanced_shape(sides: Array, nodes: int) -> tuple[int, int, int]:
    """Shape whose cells are as cubic and whose count is as near to ``nodes`` as whole numbers allow."""
    along = sides.tolist()
    low, high = 1e-12 * max(along), max(along)

    def shape_at(spacing: float) -> tuple[int, int, int]:
        x, y, z = (max(round(side / spacing) + 1, 2) for side in along)
        return x, y, z

    while low < (middle := sqrt(low * high)) < high:  # bisection on the logarithm of the spacing, to its last bit
        if prod(shape_at(middle)) > nodes:
            low = middle
        else:
            high = middle
    return min((shape_at(low), shape_at(high)), key=lambda shape: abs(prod(shape) - nodes))

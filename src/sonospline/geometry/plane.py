"""An image plane: pixels on a rectangle anywhere in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _memory, _validate
from .._by_value import ByValue
from .._shown import lengths, place, shown, size
from . import pose
from .grid import Grid

Array = NDArray[np.float64]

_PARALLEL = 1e-9


@dataclass(frozen=True, eq=False, repr=False, init=False)
class ImagePlane(ByValue):
    """A rectangle of pixels with a pose.

    Parameters
    ----------
    image_to_reference : (4, 4) array_like
        Rigid transform from the image (mm from the centre of pixel (0, 0): x right, y down, z = x cross y) to
        the world.
    shape : (int, int)
        Rows and columns.
    spacing_mm : (float, float) or float
        Distance between pixel centres along x and y.
    corner_mm : (float, float), default: (0, 0)
        Where the axes of a picture count pixel (0, 0): from the middle of the probe's face, for a probe's.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.geometry import ImagePlane
    >>> plane = ImagePlane(image_to_reference=np.eye(4), shape=(100, 50), spacing_mm=0.5)
    >>> plane.extent
    (-0.25, 24.75, 49.75, -0.25)
    """

    image_to_reference: Array
    shape: tuple[int, int]
    spacing_mm: tuple[float, float]
    corner_mm: tuple[float, float] = (0.0, 0.0)

    def __init__(
        self,
        *,
        image_to_reference: ArrayLike,
        shape: Sequence[int],
        spacing_mm: float | Sequence[float],
        corner_mm: Sequence[float] = (0.0, 0.0),
    ) -> None:
        set_ = object.__setattr__
        set_(self, "image_to_reference", pose.rigid("image_to_reference", image_to_reference))
        if np.shape(shape) != (2,):
            raise ValueError(f"shape = {shown(shape)} is not two whole numbers; give rows and columns")
        set_(self, "shape", tuple(_validate.count("shape", n) for n in shape))
        spacing = np.broadcast_to(np.ravel(spacing_mm), 2) if np.size(spacing_mm) in (1, 2) else ()
        if len(spacing) != 2:
            raise ValueError(f"spacing_mm = {shown(spacing_mm)} is not one or two numbers; give mm along x and y")
        set_(self, "spacing_mm", tuple(_validate.number("spacing_mm", h, positive=True) for h in spacing))
        set_(self, "corner_mm", tuple(_validate.real("corner_mm", c) for c in corner_mm))

    def __repr__(self) -> str:
        at = place(self.image_to_reference[:3, 3])
        return f"ImagePlane({size(self.shape)} pixels, {lengths(self.spacing_mm)}, first at {at})"

    @classmethod
    def crossing(
        cls, grid: Grid, *, normal: ArrayLike, through: ArrayLike, right: ArrayLike | None = None, pixels: int = 512
    ) -> ImagePlane:
        """Return the plane across a box: it covers what the plane cuts from the box's bounding sphere.

        Parameters
        ----------
        grid : Grid
            The box.
        normal : (3,) array_like
            World direction the plane is seen along.
        through : (3,) array_like
            A world point of the plane.
        right : (3,) array_like, optional
            World direction of the picture's x; by default the world axis that lies best in the plane.
        pixels : int, default: 512
            Pixels along the longer side.
        """
        seen_along = _validate.vector("normal", normal)
        if not seen_along.any():
            raise ValueError("normal = [0, 0, 0] has no direction; give the direction the plane is seen along")
        seen_along = seen_along / np.linalg.norm(seen_along)
        x = np.eye(3)[int(np.argmin(np.abs(seen_along)))] if right is None else _validate.vector("right", right)
        origin = _validate.vector("through", through)
        x = x - (x @ seen_along) * seen_along
        if np.linalg.norm(x) <= _PARALLEL:
            raise ValueError(f"right = {x.tolist()} is zero or parallel to the normal; give a vector across it")
        transform = pose.facing(origin, depth=np.cross(seen_along, x), right=x)
        corners = grid.world(np.indices((2, 2, 2)).reshape(3, -1).T * grid.extent)
        flat = pose.to_image(transform, corners)[:, :2]
        low, size = flat.min(axis=0), np.ptp(flat, axis=0)
        spacing = float(size.max()) / _validate.count("pixels", pixels, least=2)
        columns, rows = (max(1, round(float(side / spacing))) for side in size)
        corner = (float(low[0] + spacing / 2), float(low[1] + spacing / 2))
        return cls.placed(transform, shape=(rows, columns), spacing_mm=(spacing, spacing), corner_mm=corner)

    @classmethod
    def along(
        cls, grid: Grid, right: ArrayLike, *, through: ArrayLike, down: ArrayLike | None = None, pixels: int = 512
    ) -> ImagePlane:
        """Return the plane across a box that holds a direction, such as a needle's: it runs to the right.

        Parameters
        ----------
        grid, through, pixels
            As for :meth:`crossing`.
        right : (3,) array_like
            World direction of the picture's x.
        down : (3,) array_like, optional
            World direction that lies in the plane, too; by default the world axis most across ``right``.

        Examples
        --------
        >>> import sonospline as ss
        >>> from sonospline.geometry import ImagePlane
        >>> needle = ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5))
        >>> plane = ImagePlane.along(ss.Grid.unit_cube(25), needle.direction, through=needle.tip)
        >>> plane.project(needle.entry[None])[0, 2].round(9) + 0.0
        np.float64(0.0)
        """
        x = _validate.vector("right", right)
        y = np.eye(3)[int(np.argmin(np.abs(x)))] if down is None else _validate.vector("down", down)
        return cls.crossing(grid, normal=np.cross(x, y), through=through, right=x, pixels=pixels)

    @classmethod
    def placed(
        cls,
        axes_to_reference: Array,
        *,
        shape: Sequence[int],
        spacing_mm: float | Sequence[float],
        corner_mm: Sequence[float],
    ) -> ImagePlane:
        """Return the plane whose axes lie in the world as given, its pixel (0, 0) at ``corner_mm`` of them.

        With a ``ProbeToReference`` these are the axes of a probe's picture.
        """
        pixel = pose.shifted(axes_to_reference, corner_mm[0], corner_mm[1])
        return cls(image_to_reference=pixel, shape=shape, spacing_mm=spacing_mm, corner_mm=corner_mm)

    @cached_property
    def points(self) -> Array:
        """(rows * columns, 3) world positions of the pixel centres, row by row."""
        rows, columns = self.shape
        _memory.refuse_beyond(48 * rows * columns, f"shape = {self.shape}: the positions of its pixels")
        flat = np.zeros((rows, columns, 3))
        flat[..., 0] = self.spacing_mm[0] * np.arange(columns)
        flat[..., 1] = self.spacing_mm[1] * np.arange(rows)[:, None]
        return pose.to_reference(self.image_to_reference, flat.reshape(-1, 3))

    @property
    def axes_mm(self) -> tuple[Array, Array]:
        """(columns,) x and (rows, 1) y of the pixel centres along the axes that :attr:`extent` counts along."""
        (rows, columns), (dx, dy), (x, y) = self.shape, self.spacing_mm, self.corner_mm
        return x + dx * np.arange(columns, dtype=float), y + dy * np.arange(rows, dtype=float)[:, None]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge in mm, as matplotlib's ``imshow`` takes them with ``origin="upper"``."""
        (rows, columns), (dx, dy), (x, y) = self.shape, self.spacing_mm, self.corner_mm
        return (x - dx / 2, x + (columns - 0.5) * dx, y + (rows - 0.5) * dy, y - dy / 2)

    @property
    def affine(self) -> Array:
        """(3, 3) columns: the world steps of one column and of one row, and the world position of pixel (0, 0)."""
        x, y, _, corner = self.image_to_reference[:3].T
        return np.column_stack([self.spacing_mm[0] * x, self.spacing_mm[1] * y, corner])

    @cached_property
    def axes_to_reference(self) -> Array:
        """(4, 4) pose of the axes that :attr:`extent` and :meth:`project` count along."""
        return pose.shifted(self.image_to_reference, -self.corner_mm[0], -self.corner_mm[1])

    def project(self, points: ArrayLike) -> Array:
        """Return world points (m, 3), or one (3,), along the picture's axes: x, y and the distance z from it, mm."""
        found, shape = _validate.rows("points", points)
        return pose.to_image(self.axes_to_reference, found).reshape(*shape, 3)

    def pixels(self, points: ArrayLike) -> Array:
        """Return column and row of the feet of world points (m, 3), or of one (3,): (m, 2) or (2,), not rounded."""
        found: Array = (self.project(points)[..., :2] - self.corner_mm) / self.spacing_mm
        return found

    def misses(self, grid: Grid) -> bool:
        """Return whether no pixel lies in the box of a grid."""
        corners = grid.local(self.points)
        return not bool(((corners >= 0) & (corners <= grid.extent)).all(axis=1).any())

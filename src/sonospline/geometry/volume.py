"""A 3-D image with its place in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_value import ByValue
from .._shown import lengths, place, size
from .grid import Grid

Array = NDArray[np.float64]

_SAME = 0.01
"""Of a voxel, between two lattices that are one but for the rounding of file formats."""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Volume(ByValue):
    """Voxels indexed (i, j, k) on a lattice in world coordinates (RAS, mm).

    Parameters
    ----------
    voxels : (nx, ny, nz) ndarray
        Intensities, one number a voxel.
    spacing : (3,) sequence of float
        Distance between voxel centres along i, j, k in mm.
    origin : (3,) array_like
        World position of the centre of voxel (0, 0, 0).
    direction : (3, 3) array_like
        Columns are the world directions of i, j, k.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.geometry.volume import Volume
    >>> volume = Volume(voxels=np.zeros((10, 20, 30)), spacing=(1, 1, 2))
    >>> volume.lattice.extent.tolist(), volume
    ([9.0, 19.0, 58.0], Volume(10 x 20 x 30, 1.0 x 1.0 x 2.0 mm, float64))
    """

    voxels: NDArray[Any]
    spacing: tuple[float, float, float]
    origin: Array
    direction: Array

    def __init__(
        self,
        *,
        voxels: NDArray[Any],
        spacing: float | Sequence[float] | Array,
        origin: ArrayLike = (0, 0, 0),
        direction: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ) -> None:
        set_ = object.__setattr__
        set_(self, "voxels", voxels)
        if self.voxels.ndim != 3 or min(self.voxels.shape) < 2:
            raise ValueError(
                f"voxels has shape {self.voxels.shape}; give a 3-D image of at least 2 voxels along each axis"
            )
        lattice = Grid(shape=voxels.shape, spacing=spacing, origin=origin, direction=direction)
        set_(self, "spacing", lattice.spacing)
        set_(self, "origin", lattice.origin)
        set_(self, "direction", np.asarray(direction, float))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self._facts())})"

    def _facts(self) -> list[str]:
        """What its text says."""
        at = [f"origin {place(self.origin)}"] if np.any(self.origin) else []
        tilted = [] if self.lattice.upright else ["tilted"]
        return [size(self.voxels.shape), lengths(self.lattice.spacing), str(self.voxels.dtype), *at, *tilted]

    @cached_property
    def lattice(self) -> Grid:
        """The voxel centres as a :class:`Grid`."""
        return Grid(
            shape=self.voxels.shape,
            spacing=self.spacing,
            origin=self.origin,
            direction=self.direction,
        )

    def grid(self, nodes: int) -> Grid:
        """Return a coarser grid of about ``nodes`` nodes, from first to last voxel centre."""
        return Grid.covering(
            self.lattice.extent, nodes=nodes, origin=self.lattice.origin, direction=self.lattice.direction
        )

    def index(self, points: ArrayLike) -> Array:
        """Return continuous voxel indices (m, 3) of world points (m, 3); (3,) of one."""
        found, shape = _validate.rows("points", points)
        return (self.lattice.local(found) / self.lattice.spacing).reshape(*shape, 3)

    def position(self, index: ArrayLike) -> Array:
        """Return world points (m, 3) of continuous voxel indices (m, 3); (3,) of one."""
        found, shape = _validate.rows("index", index)
        return self.lattice.node(found).reshape(*shape, 3)

    def lies_on(self, lattice: Grid) -> bool:
        """Return whether the voxels lie on another lattice, to a hundredth of its voxel."""
        if self.voxels.shape != lattice.shape:
            return False
        ends = np.array(lattice.shape) - 1
        corners = np.indices((2, 2, 2)).reshape(3, -1).T * ends
        off = self.lattice.node(corners) - lattice.node(corners)
        return bool(np.abs(off).max() <= _SAME * min(lattice.spacing))

    def nearest_on(self, lattice: Grid, *, outside: float) -> Self:
        """Return the volume on another lattice, each voxel the nearest one here, ``outside`` beyond the last.

        Examples
        --------
        >>> import numpy as np
        >>> import sonospline as ss
        >>> from sonospline.geometry.volume import Volume
        >>> ramp = Volume(voxels=np.indices((4, 4, 4))[0], spacing=(2, 2, 2))
        >>> ramp.nearest_on(ss.Grid(shape=(6, 2, 2), spacing=1.6), outside=-1).voxels[:, 0, 0].tolist()
        [0, 1, 2, 2, 3, -1]
        """
        from scipy.ndimage import affine_transform

        ours = self.lattice
        turn = (ours.direction.T @ lattice.direction) * lattice.spacing / np.array(ours.spacing)[:, None]
        start = self.index(lattice.origin[None])[0]
        voxels = affine_transform(
            self.voxels, turn, start, lattice.shape, order=0, mode="grid-constant", cval=outside
        )  # fmt: skip
        return replace(self, voxels=voxels, spacing=lattice.spacing, origin=lattice.origin, direction=lattice.direction)

    def sample(self, points: ArrayLike, *, outside: float = np.nan) -> NDArray[Any]:
        """Return intensities (m,) at world points (m, 3), linear between voxels; a number at one."""
        from scipy.ndimage import map_coordinates

        found, shape = _validate.rows("points", points)
        coordinates = self.index(found).T
        intensities = map_coordinates(self.voxels.astype(float), coordinates, order=1, cval=outside)
        return intensities.reshape(shape)[()]

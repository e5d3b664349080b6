"""Any plane of a real 3-D image, while the tissue in it moves."""

from __future__ import annotations

import logging
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..fields.field import Field
from ..fields.grid_field import GridField, at_nodes
from ..geometry.plane import ImagePlane
from ..geometry.volume import Volume
from .frame import Frame

logger = logging.getLogger(__name__)

TOLERANCE = 0.01
"""Of the inverse map, in units of the voxel: its last change, and how far it may bend between four pixels."""
_MOST_ITERATIONS = 30


def swept(volume: Volume, *, closing_mm: float = 2.0) -> NDArray[np.bool_]:
    """Return which voxels a freehand sweep saw: those above zero, and the dark specks among them.

    Reconstructed volumes hold 0 both where no frame passed and in anechoic tissue; holes narrower
    than twice ``closing_mm`` count as tissue.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.ultrasound import swept
    >>> from sonospline.geometry.volume import Volume
    >>> voxels = np.zeros((20, 20, 20)); voxels[:10] = 5; voxels[4, 9, 9] = 0
    >>> int(swept(Volume(voxels=voxels, spacing=(1, 1, 1))).sum())
    4000
    """
    from scipy.ndimage import distance_transform_edt

    seen = volume.voxels > 0
    if not seen.any():
        return seen
    # Closing by distance: grow by closing_mm, then shrink again; the border counts as more of the same.
    margin = [int(np.ceil(closing_mm / h)) + 1 for h in volume.lattice.spacing]
    padded = np.pad(seen, [(m, m) for m in margin], mode="edge")
    grown = distance_transform_edt(~padded, sampling=volume.lattice.spacing) <= closing_mm
    closed = padded | (distance_transform_edt(grown, sampling=volume.lattice.spacing) > closing_mm)
    return closed[tuple(slice(m, -m) for m in margin)]


class Reslicer:
    """A 3-D image made ready to be cut along any plane, deformed by any field.

    Parameters
    ----------
    volume : Volume
        The image of the undeformed tissue.
    seen : (nx, ny, nz) bool ndarray, optional
        Voxels that hold an image (see :func:`swept`); by default all.

    Examples
    --------
    >>> from sonospline.geometry.layered_block import layered_block
    >>> from sonospline.geometry import ImagePlane
    >>> from sonospline.ultrasound import Reslicer
    >>> volume = layered_block()
    >>> plane = ImagePlane.crossing(volume.lattice, normal=(0, 0, 1), through=(48, 42, 42), pixels=256)
    >>> Reslicer(volume).cut(plane).pixels.shape
    (224, 256)
    """

    def __init__(self, volume: Volume, *, seen: NDArray[np.bool_] | None = None) -> None:
        if not isinstance(volume, Volume):
            raise ValueError(f"volume = {type(volume).__name__} is not a Volume; read one with io.volumes.read_volume")
        if not np.issubdtype(volume.voxels.dtype, np.number) or np.iscomplexobj(volume.voxels):
            raise ValueError(f"volume has voxels of type {volume.voxels.dtype}; give a grey image of real numbers")
        if seen is not None and np.shape(seen) != volume.voxels.shape:
            raise ValueError(f"seen has shape {np.shape(seen)}; give {volume.voxels.shape}, as the volume")
        self.volume = volume
        self._voxels = np.ascontiguousarray(volume.voxels, np.float32)
        self._seen = None if seen is None else np.ascontiguousarray(seen, np.uint8)

    @cached_property
    def _still(self) -> GridField:
        return GridField(self.volume.grid(8), np.zeros((*self.volume.grid(8).shape, 3), np.float32))

    def cut(self, plane: ImagePlane, field: Field | None = None) -> Frame:
        """Return the image on a plane, with what a field has moved.

        Linear between voxels; pixels of the volume's type (rounded where that is whole). A plane that
        misses the volume gives a black frame and a warning.

        Parameters
        ----------
        plane : ImagePlane
            Where to cut.
        field : Field, optional
            The deformation; one that is not known at the nodes of its grid is sampled there.
        """
        grid_field = self._still if field is None else at_nodes(field)
        grid, lattice = grid_field.grid, self.volume.lattice
        pixel = grid.direction.T @ (plane.affine - np.outer(grid.origin, (0, 0, 1)))
        to_index = np.diag(1 / np.array(lattice.spacing)) @ lattice.direction.T
        index = np.column_stack([to_index @ grid.direction, to_index @ (grid.origin - lattice.origin)])
        tolerance = TOLERANCE * min(lattice.spacing)
        grey, mask = _core.active.reslice(
            grid_field.along_axes,
            grid.spacing,
            np.ascontiguousarray(pixel),
            self._voxels,
            self._seen,
            np.ascontiguousarray(index),
            plane.shape,
            tolerance,
            _MOST_ITERATIONS,
        )
        seen = mask.view(np.bool_)
        if not seen.any():
            logger.warning("the plane shows nothing: it misses the volume, or what the sweep saw of it")
        if np.issubdtype(self.volume.voxels.dtype, np.integer):
            grey = np.rint(grey, out=grey)
        return Frame(grey.astype(self.volume.voxels.dtype, copy=False), plane, seen)

    def __repr__(self) -> str:
        return f"Reslicer({self.volume!r})"

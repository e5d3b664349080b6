"""A field as an ITK displacement-field transform, which warps images in SimpleITK and 3D Slicer."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from ..fields.field import Field, InverseReport
from ..geometry.grid import Grid
from ..geometry.label_map import LabelMap
from ..geometry.volume import Volume
from .volumes import RAS_TO_LPS, from_sitk, place, to_sitk
from .writing import write_bytes

_ITK_NAME = "DisplacementFieldTransform_double_3_3"


@dataclass(frozen=True, eq=False)
class ImageWarp:
    """The inverse of a field, sampled on its grid: where each point of the deformed image came from.

    An ITK transform maps output points to input points, so warping an image needs the
    inverse of the forward field.
    """

    grid: Grid
    displacement: NDArray[np.float64]
    """(nx, ny, nz, 3) inverse(p) - p at each node p, RAS mm."""
    report: InverseReport

    @classmethod
    def of(cls, field: Field) -> ImageWarp:
        """Return the inverse of a field on the field's own grid.

        A node whose inverse is not known (the report counts them) keeps its place.
        """
        if field.grid is None:
            raise ValueError("field.grid = None: fit the field with grid= to sample its inverse")
        nodes = field.grid.points
        source, report = field.inverse(nodes, return_report=True)
        moved = np.where(report.converged[:, None], source - nodes, 0.0)
        return cls(field.grid, moved.reshape(*field.grid.shape, 3), report)

    def to_sitk(self) -> Any:
        """Return a SimpleITK ``DisplacementFieldTransform`` (LPS)."""
        sitk = require("SimpleITK")
        vectors = np.ascontiguousarray((self.displacement @ RAS_TO_LPS).transpose(2, 1, 0, 3))
        image = sitk.GetImageFromArray(vectors, isVector=True)
        place(image, self.grid)
        return sitk.DisplacementFieldTransform(image)

    def write(self, path: str | PathLike[str]) -> None:
        """Write the transform as an ITK .h5 file; load it in Slicer as a Transform.

        Raises
        ------
        OSError
            The file could not be written whole.
        """
        write_bytes(path, _hdf5_of(self.to_sitk()))

    def apply(self, volume: Volume) -> Volume:
        """Return the deformed image: same geometry, linear interpolation, but the nearest voxel of a label map.

        What the deformation draws in from beyond an image becomes its smallest value: black, or air; from
        beyond a label map, 0.
        """
        sitk = require("SimpleITK")
        image = to_sitk(volume)
        if isinstance(volume, LabelMap):
            nearest = sitk.Resample(image, image, self.to_sitk(), sitk.sitkNearestNeighbor, 0.0)
            return LabelMap.of(from_sitk(nearest))
        background = float(volume.voxels.min())
        return from_sitk(sitk.Resample(image, image, self.to_sitk(), sitk.sitkLinear, background))


def _hdf5_of(transform: Any) -> bytes:
    """Return the ITK transform file of a displacement field, made in memory.

    ITK's own writer fails on a full disk with a hundred lines and a crash when the process ends.
    """
    h5py = require("h5py")
    with h5py.File("displacement.h5", "w", driver="core", backing_store=False) as file:
        for name, text in (
            ("ITKVersion", require("SimpleITK").Version.ITKVersionString()),
            ("HDFVersion", h5py.version.hdf5_version),
        ):
            file.create_dataset(name, data=[text.encode()], dtype=h5py.string_dtype("ascii"))
        group = file.create_group("TransformGroup/0")
        group.create_dataset("TransformType", data=[_ITK_NAME.encode()], dtype=h5py.string_dtype("ascii"))
        group.create_dataset("TransformFixedParameters", data=np.array(transform.GetFixedParameters()))
        group.create_dataset("TransformParameters", data=np.array(transform.GetParameters()))
        file.flush()
        return bytes(file.id.get_file_image())

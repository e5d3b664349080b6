"""The inverse of a field, ready to warp images."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from .._shown import lengths, size
from ..geometry.grid import Grid
from ..geometry.label_map import LabelMap
from ..geometry.volume import Volume
from ..io.transforms import displacement_transform, write_transform
from ..io.volumes import from_sitk, to_sitk
from .maps import FieldMaps, InverseReport


@dataclass(frozen=True, eq=False, repr=False)
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
    def of(cls, field: FieldMaps) -> ImageWarp:
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
        return displacement_transform(self.grid, self.displacement)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the transform as an ITK .h5 or .tfm file; load it in Slicer as a Transform.

        Raises
        ------
        ValueError
            Another suffix.
        OSError
            The file could not be written whole.
        """
        write_transform(self.to_sitk(), path)

    def apply(self, volume: Volume) -> Volume:
        """Return the deformed image: same geometry, linear interpolation, but the nearest voxel of a label map.

        What the deformation draws in from beyond an image becomes its smallest value: black, or air; from
        beyond a label map, 0.
        """
        sitk = require("SimpleITK")
        image = to_sitk(volume)
        if isinstance(volume, LabelMap):
            nearest = sitk.Resample(image, image, self.to_sitk(), sitk.sitkNearestNeighbor, 0.0)
            return LabelMap.of(from_sitk(nearest)).named(volume.names)
        background = float(volume.voxels.min())
        return from_sitk(sitk.Resample(image, image, self.to_sitk(), sitk.sitkLinear, background))

    def __repr__(self) -> str:
        return f"ImageWarp({size(self.grid.shape)}, {lengths(self.grid.spacing)})"

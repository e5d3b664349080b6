"""A field for other programs: PyVista's meshes, and files by their suffix."""

from __future__ import annotations

from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .._extras import require
from ..io import transforms
from ..io.volumes import vector_image
from ..io.vtk import write_vti
from ..io.writing import write_bytes, write_image
from .image_warp import ImageWarp
from .maps import FieldMaps

_IMAGES = (".nrrd", ".mha")
SUFFIXES = (*transforms.SUFFIXES, *_IMAGES, ".vti", ".npz")
"""Of the files a field can be saved as."""


def mesh(field: FieldMaps) -> Any:
    """Return a field's grid as PyVista's, with what happens at its nodes."""
    grid = field.require_grid()
    pyvista = require("pyvista")
    if grid.upright:
        made = pyvista.ImageData(dimensions=grid.shape, spacing=grid.spacing, origin=tuple(grid.origin))
    else:
        made = pyvista.StructuredGrid(*np.moveaxis(grid.points.reshape(*grid.shape, 3), -1, 0))
    # VTK numbers points with the first index fastest
    made.point_data["displacement"] = field.on_grid().swapaxes(0, 2).reshape(-1, 3)
    made.point_data["det J"] = field.det_jacobian().ravel(order="F")
    return made


def save(field: FieldMaps, path: str | PathLike[str]) -> None:
    """Write a field in the format of the path's suffix, as :meth:`Field.save` says."""
    suffix = Path(path).suffix
    if suffix not in SUFFIXES:
        raise ValueError(f"path = {str(path)!r} is of an unknown file type; use one of {', '.join(SUFFIXES)}")
    grid = field.require_grid()
    if suffix in transforms.SUFFIXES:
        ImageWarp.of(field).save(path)
    elif suffix in _IMAGES:
        write_image(vector_image(grid, field.on_grid()), path)
    elif suffix == ".vti":
        write_vti(path, grid, {"displacement": field.on_grid(), "det_jacobian": field.det_jacobian()})
    else:
        packed = BytesIO()
        np.savez_compressed(
            packed, displacement=field.on_grid(), spacing=grid.spacing, origin=grid.origin, direction=grid.direction
        )
        write_bytes(path, packed.getvalue())

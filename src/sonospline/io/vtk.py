"""A field as a VTK image (.vti), which ParaView opens; LPS like every file."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from ..geometry.grid import Grid
from .volumes import RAS_TO_LPS
from .writing import write_text

_SPACE = "SPACE"
"""The field data by which 3D Slicer tells RAS from LPS; ParaView shows it among the information of the file."""


def write_vti(path: str | PathLike[str], grid: Grid, arrays: dict[str, NDArray[np.floating]]) -> None:
    """Write node arrays on a grid, so that they lie over the images that ITK and 3D Slicer write.

    Parameters
    ----------
    path : path-like
        File to write, ending in .vti.
    grid : Grid
        Its geometry, orientation included; RAS mm here, LPS in the file, which says so in the field data ``SPACE``.
    arrays : dict of str to ndarray
        Name -> values shaped like the grid. With a last axis of 3 they are vectors: RAS here, LPS in the file.

    Raises
    ------
    OSError
        The file could not be written whole.
    """
    to_vtk = require("vtkmodules.util.numpy_support").numpy_to_vtk
    image = require("vtkmodules.vtkCommonDataModel").vtkImageData()
    image.SetDimensions(grid.shape)
    image.SetSpacing(grid.spacing)
    image.SetOrigin((RAS_TO_LPS @ grid.origin).tolist())
    image.SetDirectionMatrix(*(RAS_TO_LPS @ grid.direction).ravel().tolist())
    image.GetFieldData().AddArray(_text(_SPACE, "LPS"))
    for name, values in arrays.items():
        in_file = values @ RAS_TO_LPS.astype(values.dtype) if values.ndim == 4 else values
        x_fastest = np.ascontiguousarray(in_file.swapaxes(0, 2))
        flat = x_fastest.reshape(grid.node_count, -1)
        data = to_vtk(flat, deep=True)
        data.SetName(name)
        image.GetPointData().AddArray(data)
    writer = require("vtkmodules.vtkIOXML").vtkXMLImageDataWriter()
    writer.WriteToOutputStringOn()  # VTK does not say by itself when a disk is full
    writer.SetInputData(image)
    writer.Write()
    write_text(path, writer.GetOutputString())


def _text(name: str, value: str) -> Any:
    array = require("vtkmodules.vtkCommonCore").vtkStringArray()
    array.SetName(name)
    array.InsertNextValue(value)
    return array

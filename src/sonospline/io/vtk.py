"""A field as a VTK image (.vti), which ParaView opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from ..grid import Grid


def write_vti(path: str | Path, grid: Grid, arrays: dict[str, NDArray[np.floating]]) -> None:
    """Write node arrays on a grid.

    Parameters
    ----------
    path : str or Path
        File to write, ending in .vti.
    grid : Grid
        Its geometry, orientation included; RAS mm.
    arrays : dict of str to ndarray
        Name -> values shaped like the grid, with a last axis of 3 for vectors.
    """
    to_vtk = require("vtkmodules.util.numpy_support").numpy_to_vtk
    image = require("vtkmodules.vtkCommonDataModel").vtkImageData()
    image.SetDimensions(grid.shape)
    image.SetSpacing(grid.spacing)
    image.SetOrigin(grid.origin.tolist())
    image.SetDirectionMatrix(*grid.direction.ravel().tolist())
    for name, values in arrays.items():
        x_fastest = np.ascontiguousarray(values.swapaxes(0, 2))
        flat = x_fastest.reshape(grid.node_count, -1)
        data = to_vtk(flat, deep=True)
        data.SetName(name)
        image.GetPointData().AddArray(data)
    writer = require("vtkmodules.vtkIOXML").vtkXMLImageDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    if not writer.Write():
        raise OSError(f"path = {str(path)!r} could not be written; check the folder and the disk")

"""Displacements at the nodes of a grid as an ITK transform, which warps images in SimpleITK and 3D Slicer."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from ..geometry.grid import Grid
from .volumes import vector_image
from .writing import write_bytes

SUFFIXES = (".h5", ".tfm")
"""Of the transform files that are written."""
_ITK_NAME = "DisplacementFieldTransform_double_3_3"


def displacement_transform(grid: Grid, displacement: NDArray[np.float64]) -> Any:
    """Return a SimpleITK ``DisplacementFieldTransform`` (LPS) that moves each node as given (RAS)."""
    return require("SimpleITK").DisplacementFieldTransform(vector_image(grid, displacement))


def write_transform(transform: Any, path: str | PathLike[str]) -> None:
    """Write a displacement field transform as an ITK file, HDF5 (.h5) or text (.tfm).

    Raises
    ------
    ValueError
        Another suffix.
    OSError
        The file could not be written whole.
    """
    suffix = Path(path).suffix
    if suffix not in SUFFIXES:
        raise ValueError(f"path = {str(path)!r} is of an unknown file type; use one of {', '.join(SUFFIXES)}")
    write_bytes(path, _hdf5_of(transform) if suffix == ".h5" else _text_of(transform))


def _text_of(transform: Any) -> bytes:
    """Return the text of a transform as ITK writes it, to the last bit of every number."""
    numbers = {"Parameters": transform.GetParameters(), "FixedParameters": transform.GetFixedParameters()}
    lines = ["#Insight Transform File V1.0", "#Transform 0", f"Transform: {_ITK_NAME}"]
    lines += [f"{name}: {' '.join(map(repr, values))}" for name, values in numbers.items()]
    return ("\n".join(lines) + "\n").encode()


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

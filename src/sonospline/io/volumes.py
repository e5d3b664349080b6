"""Volumes by SimpleITK. Files are LPS; inside the package everything is RAS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _memory
from .._extras import require
from ..geometry.grid import Grid
from ..geometry.volume import Volume
from .dicom_slices import is_dicom
from .dicom_volume import read_dicom_volume
from .headers import SUFFIXES, WHOLE, Header, HeaderError, read_header
from .writing import write_image

_LARGEST_VOXEL = 1e30
_RESAMPLE = "resample the image onto axes at right angles"

RAS_TO_LPS = np.diag([-1.0, -1.0, 1.0])
"""Flips x and y of positions and of displacement vectors; its own inverse."""


def suffix_of(path: Path, name: str = "volume") -> str:
    """Return the suffix that what is made of an image is written with: its own, and ``.nrrd`` for DICOM.

    Raises
    ------
    ValueError
        A file type that is none.
    """
    if is_dicom(path):
        return ".nrrd"
    for suffix in SUFFIXES:
        if path.name.lower().endswith(suffix):
            return suffix
    raise ValueError(f"{name} = {str(path)!r} is of an unknown file type; use one of {', '.join(SUFFIXES)}, or DICOM")


def read_volume(path: str | PathLike[str], *, name: str = "volume") -> Volume:
    """Read a 3-D, single-channel image.

    Parameters
    ----------
    path : path-like
        A .nrrd, .mha or .nii.gz file (or .nhdr, .mhd, .nii); or DICOM: a folder, of which the series with most
        slices is read, one slice for its series, or a file of many (extra ``dicom``).
    name : str, default: "volume"
        The argument, as an error names it.

    Raises
    ------
    ValueError
        No such file, an unknown type, an image that is 2-D, 4-D, coloured or empty, or a
        file that cannot be read or is truncated. Slices of DICOM that are no lattice: some are missing, or the gantry
        was tilted.
    """
    path = Path(path)
    if is_dicom(path):
        return read_dicom_volume(path, name)
    suffix_of(path, name)
    with _errors_named(where := f"{name} = {str(path)!r}"):
        header, reader = _open(path, name)
        _refuse_unfit(where, header, reader)
        voxels = _voxels(header, reader)
        _refuse_endless(where, voxels)
        return Volume(voxels=voxels, **_placement(reader))


def read_image(path: Path, name: str) -> Any:
    """Read an image of one of :data:`SUFFIXES`, of any dimension and colour, as SimpleITK's.

    Raises
    ------
    ValueError
        A file that cannot be read: damaged, cut, or of a kind that would be read wrongly.
    """
    with _errors_named(f"{name} = {str(path)!r}"):
        header, reader = _open(path, name)
        header.check_bytes()
        return reader.Execute()


def write_volume(volume: Volume, path: str | PathLike[str]) -> None:
    """Write a volume, compressed, in the format of the path's suffix; OSError where it does not arrive whole."""
    write_image(to_sitk(volume), path)


def from_sitk(image: Any) -> Volume:
    """Return a SimpleITK image (LPS) as a Volume (RAS); the voxels are copied."""
    voxels = require("SimpleITK").GetArrayFromImage(image).transpose(2, 1, 0)
    return Volume(voxels=voxels, **_placement(image))


def to_sitk(volume: Volume) -> Any:
    """Return a Volume (RAS) as a SimpleITK image (LPS)."""
    image = require("SimpleITK").GetImageFromArray(volume.voxels.transpose(2, 1, 0))
    place(image, volume.lattice)
    return image


def vector_image(grid: Grid, vectors: NDArray[np.floating]) -> Any:
    """Return vectors at the nodes of a grid, (nx, ny, nz, 3) RAS, as a SimpleITK vector image (LPS)."""
    x_fastest = np.ascontiguousarray((vectors @ RAS_TO_LPS.astype(vectors.dtype)).transpose(2, 1, 0, 3))
    image = require("SimpleITK").GetImageFromArray(x_fastest, isVector=True)
    place(image, grid)
    return image


def place(image: Any, lattice: Any) -> None:
    """Give a SimpleITK image the geometry of a :class:`~sonospline.Grid`."""
    image.SetSpacing(lattice.spacing)
    image.SetOrigin((RAS_TO_LPS @ lattice.origin).tolist())
    image.SetDirection((RAS_TO_LPS @ lattice.direction).ravel().tolist())


@contextmanager
def _errors_named(where: str) -> Iterator[None]:
    """Name the file, and what to do, in whatever goes wrong in reading it."""
    try:
        yield
    except HeaderError as error:
        raise ValueError(f"{where} cannot be read ({error}); {error.remedy}") from None
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        remedy = _RESAMPLE if "orthonormal" in reason else WHOLE
        raise ValueError(f"{where} cannot be read ({reason}); {remedy}") from None


def _open(path: Path, name: str) -> tuple[Header, Any]:
    """An image's header, checked, and SimpleITK's reader that has read it, too."""
    header = read_header(path, name)
    _memory.refuse_beyond(2 * header.voxels_bytes, f"{name} = {str(path)!r}: its voxels")
    reader = require("SimpleITK").ImageFileReader()
    reader.SetFileName(str(path))
    reader.SetImageIO(header.reader)
    reader.ReadImageInformation()
    return header, reader


def _voxels(header: Header, reader: Any) -> NDArray[Any]:
    """Voxels by i, j, k. What is packed is unpacked here, once, for SimpleITK does not ask whether it was whole."""
    if header.payload.packed and not header.scaled and reader.GetSize() == header.sizes:
        return header.unpacked()
    header.check_bytes()
    voxels: NDArray[Any] = require("SimpleITK").GetArrayFromImage(reader.Execute()).transpose(2, 1, 0)
    if [n for n in voxels.shape if n > 1] != [n for n in header.sizes if n > 1]:
        raise HeaderError(f"sizes {list(header.sizes)} that SimpleITK takes for {list(voxels.shape)}")
    return voxels


def _refuse_unfit(where: str, header: Header, reader: Any) -> None:
    """Refuse what is no 3-D grey image on a lattice."""
    if header.tracked:
        frames = f" of {header.sizes[-1]} frames" if len(header.sizes) > 2 else ""
        raise ValueError(
            f"{where} is a tracked recording{frames}, not a 3-D image; reconstruct a volume from it (Volume "
            "Reconstruction in 3D Slicer, VolumeReconstructor of PLUS)"
        )
    size, channels = reader.GetSize(), reader.GetNumberOfComponents()
    if header.payload.path.name.lower().endswith(".seg.nrrd") and (len(size) != 3 or channels != 1):
        raise ValueError(f"{where} is a segmentation in several layers; export it as one label map from 3D Slicer")
    if len(size) != 3 or min(size) < 2:
        raise ValueError(f"{where} has size {size}; give a 3-D image of at least 2 voxels along each axis")
    if channels != 1:
        raise ValueError(f"{where} has {channels} channels a voxel; give a grey image, not colour or vectors")
    try:
        Grid(shape=size, **_placement(reader))
    except ValueError as error:
        raise ValueError(f"{where}: {error}; {_RESAMPLE}") from None


def _refuse_endless(where: str, voxels: NDArray[Any]) -> None:
    """Refuse infinite numbers, and those that single precision does not hold; NaN, where nothing is known, may be."""
    if not np.issubdtype(voxels.dtype, np.floating):
        return
    largest = max(-np.fmin.reduce(voxels, axis=None), np.fmax.reduce(voxels, axis=None))
    if not largest <= _LARGEST_VOXEL:
        raise ValueError(f"{where} has a voxel of {largest:g}; give numbers of at most {_LARGEST_VOXEL:g} in size")


def _placement(image: Any) -> dict[str, Any]:
    """Spacing, origin and direction in RAS of what SimpleITK says in LPS."""
    return {
        "spacing": image.GetSpacing(),
        "origin": RAS_TO_LPS @ np.array(image.GetOrigin()),
        "direction": RAS_TO_LPS @ np.array(image.GetDirection()).reshape(3, 3),
    }

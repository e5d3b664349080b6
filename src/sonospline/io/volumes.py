"""Volumes by SimpleITK. Files are LPS; inside the package everything is RAS."""

from __future__ import annotations

import gzip
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from .._extras import require
from ..volume import Volume
from .files import regular_file
from .writing import write_image

SUFFIXES = (".nrrd", ".nhdr", ".mha", ".mhd", ".nii", ".nii.gz")

_NIFTI_HEADER = 352

RAS_TO_LPS = np.diag([-1.0, -1.0, 1.0])
"""Flips x and y of positions and of displacement vectors; its own inverse."""


def suffix_of(path: Path, name: str = "volume") -> str:
    """Return the volume suffix of a path, or raise ValueError for a file type that is not one."""
    for suffix in SUFFIXES:
        if path.name.lower().endswith(suffix):
            return suffix
    raise ValueError(f"{name} = {str(path)!r} is of an unknown file type; use one of {', '.join(SUFFIXES)}")


def read_volume(path: str | Path, *, name: str = "volume") -> Volume:
    """Read a 3-D, single-channel image.

    Parameters
    ----------
    path : str or Path
        A .nrrd, .mha or .nii.gz file (or .nhdr, .mhd, .nii).
    name : str, default: "volume"
        The argument, as an error names it.

    Raises
    ------
    ValueError
        No such file, an unknown type, an image that is 2-D, 4-D, coloured or empty, or a
        file that cannot be read or is truncated.
    """
    path = Path(path)
    suffix_of(path, name)
    regular_file(path, name, "the path of an image file")
    sitk = require("SimpleITK")
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        _refuse_unfit(path, name, reader)
        _refuse_truncated(path, reader)
        image = reader.Execute()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise ValueError(f"{name} = {str(path)!r} cannot be read ({reason}); check that the file is whole") from None
    return from_sitk(image)


def write_volume(volume: Volume, path: str | Path) -> None:
    """Write a volume, compressed, in the format of the path's suffix; OSError where it does not arrive whole."""
    write_image(to_sitk(volume), path)


def from_sitk(image: Any) -> Volume:
    """Return a SimpleITK image (LPS) as a Volume (RAS); the voxels are copied."""
    sitk = require("SimpleITK")
    return Volume(
        voxels=sitk.GetArrayFromImage(image).transpose(2, 1, 0),
        spacing=image.GetSpacing(),
        origin=RAS_TO_LPS @ np.array(image.GetOrigin()),
        direction=RAS_TO_LPS @ np.array(image.GetDirection()).reshape(3, 3),
    )


def to_sitk(volume: Volume) -> Any:
    """Return a Volume (RAS) as a SimpleITK image (LPS)."""
    image = require("SimpleITK").GetImageFromArray(volume.voxels.transpose(2, 1, 0))
    place(image, volume.lattice)
    return image


def place(image: Any, lattice: Any) -> None:
    """Give a SimpleITK image the geometry of a :class:`~sonospline.Grid`."""
    image.SetSpacing(lattice.spacing)
    image.SetOrigin((RAS_TO_LPS @ lattice.origin).tolist())
    image.SetDirection((RAS_TO_LPS @ lattice.direction).ravel().tolist())


def _refuse_unfit(path: Path, name: str, reader: Any) -> None:
    size, channels = reader.GetSize(), reader.GetNumberOfComponents()
    where = f"{name} = {str(path)!r}"
    if len(size) != 3 or min(size) < 2:
        raise ValueError(f"{where} has size {size}; give a 3-D image of at least 2 voxels along each axis")
    if channels != 1:
        raise ValueError(f"{where} has {channels} channels a voxel; give a grey image, not colour or vectors")


def _refuse_truncated(path: Path, reader: Any) -> None:
    """Refuse a file with fewer bytes than voxels where the format's reader pads with zeros in silence."""
    held = _payload_bytes(path)
    voxel_bytes = require("SimpleITK").Image([1, 1, 1], reader.GetPixelID()).GetSizeOfPixelComponent()
    if held is not None and held < int(np.prod(reader.GetSize())) * voxel_bytes:
        raise RuntimeError("fewer bytes than voxels")


def _payload_bytes(path: Path) -> int | None:
    """Bytes of voxels a file holds; None where its reader checks that by itself."""
    suffix = suffix_of(path)
    if suffix == ".nii":
        return path.stat().st_size - _NIFTI_HEADER
    if suffix == ".nii.gz":
        try:
            with gzip.open(path) as stream:
                return sum(len(chunk) for chunk in iter(lambda: stream.read(1 << 20), b"")) - _NIFTI_HEADER
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise RuntimeError(str(error)) from None
    if suffix in (".mha", ".mhd"):
        return _meta_image_bytes(path)
    return None


def _meta_image_bytes(path: Path) -> int | None:
    with path.open("rb") as stream:
        header = stream.read(1 << 16)
    entry = re.search(rb"^ElementDataFile *= *([^\r\n]+)\r?\n", header, re.MULTILINE)
    if entry is None or re.search(rb"^CompressedData *= *True", header, re.MULTILINE):
        return None
    if entry[1] == b"LOCAL":
        return path.stat().st_size - entry.end()
    data = path.parent / entry[1].decode(errors="replace")
    return data.stat().st_size if data.is_file() else None

"""The header of an image file, read and checked by its suffix."""

from __future__ import annotations

from pathlib import Path

from ..files import open_file
from . import meta_image, nifti, nrrd
from .header import Header

_PARSERS = {
    ".nrrd": nrrd.parse,
    ".nhdr": nrrd.parse,
    ".mha": meta_image.parse,
    ".mhd": meta_image.parse,
    ".nii": nifti.parse,
    ".nii.gz": nifti.parse_packed,
}
SUFFIXES = tuple(_PARSERS)


def read_header(path: Path, name: str = "volume") -> Header:
    """Read and check the header of an image file, by its suffix.

    Raises
    ------
    HeaderError
        A header that is not of its format, or that cannot be true.
    ValueError
        No ordinary file.
    """
    suffix = ".nii.gz" if path.suffix.lower() == ".gz" else path.suffix.lower()
    with open_file(path, name, "the path of an image file") as stream:
        header = _PARSERS[suffix](path, stream)
    header.check()
    return header

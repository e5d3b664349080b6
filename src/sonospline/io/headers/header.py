"""What a header says, and whether it can be true."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .errors import HeaderError
from .payload import Payload

LARGEST_MM = 1e9
"""Coordinates and spacings beyond are no millimetres of anybody's."""
LARGEST_COSINE = 1e3
"""Of a direction matrix: far above 1, since it is the size that makes ITK loop; the rest it refuses by itself."""
MOST_DIMENSIONS = 7

_MILLIMETRES = ("mm", "millimeter", "millimeters", "millimetre", "millimetres", "", "?")
_MOST_LINES, _LONGEST_LINE, _LONGEST_HEADER = 200_000, 1 << 17, 64 << 20
_LONGEST_NUMBER, _LONGEST_NAME = 64, 255
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?\d{1,18}")


@dataclass(frozen=True, kw_only=True)
class Header:
    """A header in the terms of every format.

    Parameters
    ----------
    reader : str
        ITK's reader of the format.
    sizes : tuple of int
        Along each axis of the file.
    dtype : numpy.dtype
        Of the numbers, as they are stored.
    channels : int, default: 1
        Numbers a voxel.
    scaled : bool, default: False
        Whether the numbers stand for others.
    spacing, origin, direction : sequence of float
        As far as the header gives them.
    payload : Payload
        Where the voxels are.
    tracked : bool
        Whether frames of a tracked recording follow each other along the last axis.
    """

    reader: str
    sizes: tuple[int, ...]
    dtype: np.dtype[Any]
    channels: int = 1
    scaled: bool = False
    spacing: Sequence[float] = ()
    origin: Sequence[float] = ()
    direction: Sequence[float] = ()
    payload: Payload
    tracked: bool = False

    @property
    def voxels_bytes(self) -> int:
        """Bytes that all voxels take, as they are stored."""
        return prod(self.sizes) * self.channels * self.dtype.itemsize

    def check(self) -> None:
        """Raise HeaderError where a size or a place is absurd, or the file holds fewer bytes than voxels."""
        if not 1 <= len(self.sizes) <= MOST_DIMENSIONS or min(self.sizes) < 1:
            raise HeaderError(f"sizes {list(self.sizes)}")
        for name, values, largest in (
            ("spacing", self.spacing, LARGEST_MM),
            ("origin", self.origin, LARGEST_MM),
            ("direction", self.direction, LARGEST_COSINE),
        ):
            if not all(isfinite(value) and abs(value) <= largest for value in values):
                raise HeaderError(f"{name} {[float(value) for value in values]}")
        if not all(abs(value) >= 1 / LARGEST_MM for value in self.spacing):
            raise HeaderError(f"spacing {[float(value) for value in self.spacing]}")

    def check_bytes(self) -> None:
        """Raise HeaderError where the file holds fewer bytes than voxels; reads what is compressed."""
        if self.payload.held(self.voxels_bytes) < self.voxels_bytes:
            raise HeaderError("fewer bytes than voxels")

    def unpacked(self) -> NDArray[Any]:
        """Return the voxels of a compressed file, indexed along the axes of :attr:`sizes`."""
        stored = self.payload.unpacked(self.voxels_bytes).view(self.dtype).reshape(self.sizes, order="F")
        return stored.astype(self.dtype.newbyteorder("="), copy=False)


def lines(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of a file from where it stands, then nothing but empty ones.

    Raises
    ------
    HeaderError
        More lines, or longer ones, than any header has: what is read is no header, and could go on for ever.
    """
    start = stream.tell()
    for _ in range(_MOST_LINES):
        line = stream.readline(_LONGEST_LINE)
        if len(line) == _LONGEST_LINE or stream.tell() - start > _LONGEST_HEADER:
            break
        yield line
    raise HeaderError(f"its header has more than {_MOST_LINES:,} lines, or one of more than {_LONGEST_LINE:,} bytes")


def numbers(field: str, text: str, count: int | None = None) -> list[float]:
    """Return the finite numbers of a header's field."""
    words = text.split()
    fit = all(len(word) <= _LONGEST_NUMBER and _NUMBER.fullmatch(word) for word in words)
    if not fit or (count is not None and len(words) != count):
        raise HeaderError(f"{field} = {shown(text)}")
    return [float(word) for word in words]


def whole(field: str, text: str) -> int:
    """Return the whole number of a header's field."""
    if not _WHOLE.fullmatch(text):
        raise HeaderError(f"{field} = {shown(text)}")
    return int(text)


def shown(text: str) -> str:
    """Return a value as an error shows it: short, on one line."""
    return repr(text if len(text) <= 60 else text[:57] + "...")


def refuse_other_units(field: str, unit: str) -> None:
    """Refuse a length that is not in millimetres: ITK reads the number and leaves out its unit."""
    if unit.lower() not in _MILLIMETRES:
        raise HeaderError(f"{field} = {shown(unit)}, and only millimetres are read", "save it in mm")


def data_file(path: Path, text: str) -> Path:
    """Return the one file beside a header that holds its voxels.

    Raises
    ------
    HeaderError
        A list or a pattern of files, or no ordinary file.
    """
    if not text or "%" in text or text.upper().startswith("LIST"):
        raise HeaderError(f"voxels in several files, {shown(text)}", "save the image as one file")
    data = path.parent / text
    if len(text.encode()) > _LONGEST_NAME or not data.is_file():
        raise HeaderError(f"its voxels are to be in {shown(text)}, which is no file here", "keep both together")
    return data

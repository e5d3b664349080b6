"""Headers of NIfTI-1 files (.nii, .nii.gz)."""

from __future__ import annotations

import struct
from math import isfinite, isnan
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .errors import HeaderError
from .header import Header
from .payload import Payload, unpack

_SIZE, _FIRST_VOXEL = 348, 352
_TYPES = {
    2: ("u1", 1), 4: ("i2", 1), 8: ("i4", 1), 16: ("f4", 1), 32: ("f4", 2), 64: ("f8", 1), 128: ("u1", 3),
    256: ("i1", 1), 512: ("u2", 1), 768: ("u4", 1), 1024: ("i8", 1), 1280: ("u8", 1), 1792: ("f8", 2), 2304: ("u1", 4),
}  # fmt: skip
"""Of a number, and how many a voxel has, by the code of the voxel's type."""
_RESAVE = "save it again as .nii.gz"


def parse(path: Path, stream: BinaryIO) -> Header:
    """Return the header of a .nii file."""
    return _header(path, stream.read(_SIZE), packed=False)


def parse_packed(path: Path, stream: BinaryIO) -> Header:
    """Return the header of a .nii.gz file."""
    return _header(path, unpack(stream, _SIZE), packed=True)


def _header(path: Path, raw: bytes, *, packed: bool) -> Header:
    if len(raw) < _SIZE:
        raise HeaderError("shorter than a header")
    order = _byte_order(raw)

    def read(code: str, offset: int) -> tuple[float, ...]:
        return struct.unpack_from(order + code, raw, offset)

    dimensions = [int(n) for n in read("8h", 40)]
    dimensions[4:] = [n or 1 for n in dimensions[4:]]
    if not 1 <= dimensions[0] <= 7:
        raise HeaderError(f"{dimensions[0]} dimensions")
    (kind,) = read("h", 70)
    if kind not in _TYPES:
        raise HeaderError(f"voxels of type {kind:.0f}", _RESAVE)
    (start,) = read("f", 108)
    if not (isfinite(start) and start >= _FIRST_VOXEL and start == int(start) and start < 2**31):
        raise HeaderError(f"its voxels start at byte {start:g}")
    letters, channels = _TYPES[int(kind)]
    spacing = [size for size in read("8f", 76)[1 : min(dimensions[0], 3) + 1] if size]  # 0: not said
    origin, direction = _place(read("2h", 252), read("6f", 256), read("12f", 280))
    return Header(
        reader="NiftiImageIO",
        sizes=tuple(dimensions[1 : dimensions[0] + 1]),
        dtype=np.dtype(order + letters),
        channels=channels,
        scaled=_scaled(*read("2f", 112)),
        spacing=spacing,
        origin=origin,
        direction=direction,
        payload=Payload(path=path, offset=0, packed=packed, skip=int(start)),
    )


def _byte_order(raw: bytes) -> str:
    for order in "<>":
        size = struct.unpack_from(order + "i", raw)[0]
        if size == _SIZE and raw[344:348] == b"n+1\0":
            return order
        if size == 540:
            raise HeaderError("NIfTI-2, which is not read", "save it as NIfTI-1")
    raise HeaderError("no NIfTI-1 header", _RESAVE)


def _scaled(slope: float, intercept: float) -> bool:
    """Whether voxels are scaled; refuses what readers do not agree on.

    Nothing is scaled where the slope is 0 or NaN, but for a slope of 0 ITK adds the intercept.
    """
    if isnan(slope):
        return False
    if not (isfinite(slope) and isfinite(intercept)) or (slope == 0 and intercept != 0):
        raise HeaderError(f"scale slope {slope:g} and intercept {intercept:g}", _RESAVE)
    return (slope, intercept) not in ((1, 0), (0, 0))


def _place(
    codes: tuple[float, ...], quaternion: tuple[float, ...], matrix: tuple[float, ...]
) -> tuple[list[float], list[float]]:
    """Numbers that place the image, origin and direction, of whichever of its two transforms are in use."""
    origin: list[float] = []
    direction: list[float] = []
    if codes[0] > 0:
        direction += quaternion[:3]
        origin += quaternion[3:]
    if codes[1] > 0:
        direction += (value for k, value in enumerate(matrix) if k % 4 != 3)
        origin += matrix[3::4]
    return origin, direction

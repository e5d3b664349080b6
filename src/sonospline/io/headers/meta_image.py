"""Headers of MetaImage files (.mha, .mhd)."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from .errors import HeaderError
from .header import Header, data_file, lines, numbers, refuse_other_units, shown, whole
from .payload import Payload

_MOST_DIMENSIONS = 4

_SEPARATOR = re.compile(rb"[=:]")
_PLACES = ("Offset", "Position", "Origin")
_MATRICES = ("TransformMatrix", "Rotation", "Orientation")
_ORDERS = ("BinaryDataByteOrderMSB", "ElementByteOrderMSB")
_SCALE = {"ElementToIntensityFunctionSlope": 1.0, "ElementToIntensityFunctionOffset": 0.0}
_KNOWN = {
    *_PLACES, *_MATRICES, *_ORDERS, *_SCALE, "NDims", "DimSize", "ElementType", "ElementNumberOfChannels",
    "ElementSpacing", "ElementSize", "CenterOfRotation", "HeaderSize", "BinaryData", "CompressedData",
    "CompressedDataSize", "Kinds", "DistanceUnits", "ElementDataFile",
}  # fmt: skip
"""Others are a user's own, such as the elements of a DICOM file."""
_SEQUENCE = re.compile(r"Seq_Frame\d+_")
_TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip


def parse(path: Path, stream: BinaryIO) -> Header:
    """Return the header of a MetaImage file."""
    fields = _header_fields(stream)
    count = whole("NDims", _needed(fields, "NDims"))
    if not 1 <= count <= _MOST_DIMENSIONS:
        raise HeaderError(f"NDims = {count}")
    kind = _needed(fields, "ElementType")
    if kind not in _TYPES:
        raise HeaderError(f"ElementType = {shown(kind)}", f"save it with one of {', '.join(_TYPES)}")
    channels = whole("ElementNumberOfChannels", fields.get("ElementNumberOfChannels", "1"))
    if not 1 <= channels <= 64:
        raise HeaderError(f"ElementNumberOfChannels = {channels}")
    _refuse_scaled(fields)
    refuse_other_units("DistanceUnits", fields.get("DistanceUnits", ""))
    sizes = tuple(whole("DimSize", word) for word in _needed(fields, "DimSize").split())
    if len(sizes) != count or min(sizes) < 1:
        raise HeaderError(f"DimSize = {shown(fields['DimSize'])} with NDims = {count}")
    place = {name: numbers(name, fields[name]) for name in ("CenterOfRotation", "ElementSize") if name in fields}
    header = Header(
        reader="MetaImageIO",
        sizes=sizes,
        dtype=_dtype(fields, _TYPES[kind]),
        channels=channels,
        spacing=_values(fields, ("ElementSpacing",), count) or place.get("ElementSize", ()),
        origin=[*_values(fields, _PLACES, count), *place.get("CenterOfRotation", ())],
        direction=_values(fields, _MATRICES, count**2),
        payload=_payload(path, fields, stream.tell()),
        tracked=any(_SEQUENCE.match(name) for name in fields) or _named_recording(path, fields),
    )
    return _from_the_end(header) if fields.get("HeaderSize") == "-1" else header


def _header_fields(stream: BinaryIO) -> dict[str, str]:
    """Names and values up to the last one, which names the data."""
    fields: dict[str, str] = {}
    for line in lines(stream):
        if not line:
            raise HeaderError("its header has no ElementDataFile")
        parts = [part.decode(errors="replace").strip() for part in _SEPARATOR.split(line, maxsplit=1)]
        if len(parts) < 2:  # blank, or the rest of a user's own text of several lines
            continue
        name, value = parts
        if name in fields and name in _KNOWN:
            raise HeaderError(f"its header has {shown(name)} twice")
        fields[name] = value
        if name == "ElementDataFile":
            break
    return fields


def _needed(fields: dict[str, str], name: str) -> str:
    if name not in fields:
        raise HeaderError(f"its header lacks {name}")
    return fields[name]


def _values(fields: dict[str, str], names: tuple[str, ...], count: int) -> list[float]:
    """Numbers of a field that has several names."""
    found = [numbers(name, fields[name], count) for name in names if name in fields]
    if any(values != found[0] for values in found):
        raise HeaderError(f"its header has more than one of {', '.join(names)}")
    return found[0] if found else []


def _dtype(fields: dict[str, str], kind: str) -> np.dtype[Any]:
    big = [_true(fields[name]) for name in _ORDERS if name in fields]
    if len(set(big)) > 1:
        raise HeaderError(f"{' and '.join(_ORDERS)} differ")
    return np.dtype((">" if big and big[0] else "<") + kind)


def _refuse_scaled(fields: dict[str, str]) -> None:
    """ITK would leave out a scale of the voxels in silence."""
    for name, plain in _SCALE.items():
        if name in fields and numbers(name, fields[name], 1) != [plain]:
            raise HeaderError(f"{name} = {shown(fields[name])} is not applied", "save the image with its real values")


def _payload(path: Path, fields: dict[str, str], header_end: int) -> Payload:
    named, before = fields["ElementDataFile"], whole("HeaderSize", fields.get("HeaderSize", "0"))
    if not _true(fields.get("BinaryData", "False")):
        raise HeaderError("its voxels are text", "save it with BinaryData = True")
    local = named in ("LOCAL", "Local", "local")
    packed = _true(fields.get("CompressedData", "False"))
    if before < -1 or (before and packed) or (before > 0 and local):
        raise HeaderError(f"HeaderSize = {before}")
    length = None
    if packed:
        length = whole("CompressedDataSize", _needed(fields, "CompressedDataSize"))
    return Payload(
        path=path if local else data_file(path, named),
        offset=header_end if local else max(before, 0),
        length=length,
        packed=packed,
    )


def _from_the_end(header: Header) -> Header:
    """The header where HeaderSize = -1: the voxels are the last bytes of their file."""
    start = header.payload.path.stat().st_size - header.voxels_bytes
    if start < 0:
        raise HeaderError("fewer bytes than voxels")
    return replace(header, payload=replace(header.payload, offset=max(start, header.payload.offset)))


def _named_recording(path: Path, fields: dict[str, str]) -> bool:
    """Whether a file without poses is called a recording and says so; ``Kinds`` alone also stands in volumes."""
    return ".igs." in path.name.lower() and fields.get("Kinds", "").endswith("list")


def _true(text: str) -> bool:
    return text[:1] in ("T", "t", "1")

"""Headers of NRRD files (.nrrd, .nhdr)."""

from __future__ import annotations

import re
from math import sqrt
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from .errors import HeaderError
from .header import LARGEST_MM, MOST_DIMENSIONS, Header, data_file, lines, numbers, refuse_other_units, shown, whole
from .payload import Payload

_LONGEST_VALUE, _LONGEST_WORD = 1 << 12, 64
_MOST_SKIPPED_LINES = 100_000

_MAGIC = re.compile(rb"NRRD000[1-5]\r?\n")
_KEY = re.compile(rb"(?:(?!: ).)*?:=")
"""A key of the user's own and its value, ``key:=value``; a field is ``field: value``."""
_SEQUENCE = re.compile(rb"Seq_Frame\d+_")
_QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"')
_VECTOR = re.compile(r"\(([^()]*)\)|none")
_ALIASES = {
    "datafile": "data file", "lineskip": "line skip", "byteskip": "byte skip", "axismins": "axis mins",
    "axismaxs": "axis maxs", "centerings": "centers", "sampleunits": "sample units", "blocksize": "block size",
    "oldmin": "old min", "oldmax": "old max",
}  # fmt: skip
_KNOWN = {
    "content", "number", "type", "block size", "dimension", "space", "space dimension", "sizes", "spacings",
    "thicknesses", "axis mins", "axis maxs", "space directions", "centers", "kinds", "labels", "units", "min", "max",
    "old min", "old max", "endian", "encoding", "line skip", "byte skip", "sample units", "space units",
    "space origin", "measurement frame", "data file",
}  # fmt: skip
_NAMES = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": ("longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",),
    "f8": ("double",),
}
_TYPES = {name: letters for letters, names in _NAMES.items() for name in names}
_ORDERS = {"little": "<", "big": ">"}
_RAW, _PACKED, _TEXT = ("raw",), ("gzip", "gz"), ("ascii", "text", "txt", "hex")


def type_name(dtype: np.dtype[Any]) -> str:
    """Return what NRRD calls a type of voxels; nothing where it has none."""
    names = _NAMES.get(dtype.str[1:], ("",))
    return dtype.name if dtype.name in names else names[0]


def parse(path: Path, stream: BinaryIO) -> Header:
    """Return the header of a NRRD file."""
    fields, tracked = _header_fields(stream)
    for name in ("type", "dimension", "sizes", "encoding"):
        if name not in fields:
            raise HeaderError(f"its header lacks {name!r}")
    count = whole("dimension", fields["dimension"])
    sizes = tuple(whole("sizes", word) for word in fields["sizes"].split())
    if not 1 <= count <= MOST_DIMENSIONS or len(sizes) != count or min(sizes) < 1:
        raise HeaderError(f"sizes = {shown(fields['sizes'])} with dimension = {count}")
    kind = fields["type"].lower()
    if kind not in _TYPES:
        raise HeaderError(f"type = {shown(kind)}", "save it with voxels that are numbers")
    _check_plain(fields)
    _check_axes(fields, count)
    _refuse_other_units(fields)
    axes, frame = _vectors("space directions", fields, count), _vectors("measurement frame", fields, count)
    return Header(
        reader="NrrdImageIO",
        sizes=sizes,
        dtype=_dtype(fields, _TYPES[kind]),
        spacing=[sqrt(sum(x * x for x in axis)) for axis in axes] or _spacings(fields, count),
        origin=[x for vector in _vectors("space origin", fields, 1) for x in vector],
        direction=[x for vector in frame for x in vector],
        payload=_payload(path, fields, stream.tell()),
        tracked=tracked,
    )


def _header_fields(stream: BinaryIO) -> tuple[dict[str, str], bool]:
    """Fields up to the empty line that ends the header, and whether poses of frames are among its keys."""
    if not _MAGIC.fullmatch(stream.readline(16)):
        raise HeaderError("no NRRD header")
    fields: dict[str, str] = {}
    tracked = False
    for ended in lines(stream):
        line = ended.rstrip(b"\r\n")
        if not line:
            break
        if line.startswith(b"#") or _KEY.match(line):
            tracked = tracked or bool(_SEQUENCE.match(line))
            continue
        name, colon, value = line.partition(b":")
        field = name.decode(errors="replace").lower()
        field = _ALIASES.get(field, field)
        if not colon or field not in _KNOWN or field in fields:
            twice = "twice" if field in fields else "which is not known"
            raise HeaderError(f"its header has {shown(field)}, {twice}")
        if len(value) > _LONGEST_VALUE:
            raise HeaderError(f"{field} has {len(value):,} characters")
        fields[field] = value.decode(errors="replace").strip()
    return fields, tracked


def _dtype(fields: dict[str, str], letters: str) -> np.dtype[Any]:
    order = fields.get("endian", "little" if letters.endswith("1") else "").lower()
    if order not in _ORDERS and fields["encoding"].lower() not in ("ascii", "text", "txt"):
        raise HeaderError(f"endian = {shown(order)}")
    return np.dtype(_ORDERS.get(order, "<") + letters)


def _vectors(name: str, fields: dict[str, str], most: int) -> list[list[float]]:
    """Vectors of a field such as ``(1,0,0) none (0,0,2)``, without those that are none."""
    text = fields.get(name, "")
    inside = [match[1] for match in _VECTOR.finditer(text)]
    vectors = [numbers(name, text.replace(",", " ")) for text in inside if text is not None]
    if _VECTOR.sub("", text).strip() or len(inside) > most or max(map(len, vectors), default=0) > MOST_DIMENSIONS:
        raise HeaderError(f"{name} = {shown(text)}")
    return vectors


def _check_plain(fields: dict[str, str]) -> None:
    """Refuse single values that are none: teem ends in a crash on long ones, where it says what is wrong."""
    for name in ("min", "max", "old min", "old max"):
        if name in fields and len(_known_numbers(name, fields)) > 1:
            raise HeaderError(f"{name} = {shown(fields[name])}")
    for name in ("number", "block size", "space dimension"):
        whole(name, fields.get(name, "0"))
    for name in ("space", "sample units"):
        if len(fields.get(name, "")) > _LONGEST_WORD:
            raise HeaderError(f"{name} = {shown(fields[name])}")


def _check_axes(fields: dict[str, str], count: int) -> None:
    """Refuse what does not give each axis its one value: teem ends in a crash on some of it."""
    for name in ("spacings", "thicknesses", "axis mins", "axis maxs"):
        known = _known_numbers(name, fields)
        if name in fields and (len(fields[name].split()) != count or max(map(abs, known), default=0) > LARGEST_MM):
            raise HeaderError(f"{name} = {shown(fields[name])} with dimension = {count}")
    for name in ("kinds", "centers"):
        words = fields.get(name, "").split()
        if name in fields and (len(words) != count or max(map(len, words)) > _LONGEST_WORD):
            raise HeaderError(f"{name} = {shown(fields[name])} with dimension = {count}")
    for name in ("labels", "units", "space units"):
        text = fields.get(name, "")
        wrong = _QUOTED.sub("", text).strip() or len(_QUOTED.findall(text)) > count
        if wrong or (name != "space units" and name in fields and len(_QUOTED.findall(text)) != count):
            raise HeaderError(f"{name} = {shown(text)} with dimension = {count}")


def _refuse_other_units(fields: dict[str, str]) -> None:
    """Refuse axes of space that are not in millimetres; other axes, of time or colour, have units of their own."""
    kinds = fields.get("kinds", "").lower().split()
    for place, unit in enumerate(_QUOTED.findall(fields.get("units", ""))):
        if not kinds or kinds[place] in ("domain", "space"):
            refuse_other_units("units", unit[1:-1])
    for unit in _QUOTED.findall(fields.get("space units", "")):
        refuse_other_units("space units", unit[1:-1])


def _known_numbers(name: str, fields: dict[str, str]) -> list[float]:
    """Numbers of a field, without those of axes that have none (nan)."""
    return numbers(name, " ".join(word for word in fields.get(name, "").split() if word.lower() != "nan"))


def _spacings(fields: dict[str, str], count: int) -> list[float]:
    """Spacings; only an axis that is not one of space may have none."""
    known = _known_numbers("spacings", fields)
    if "spacings" in fields and len(known) < min(count, 3):
        raise HeaderError(f"spacings = {shown(fields['spacings'])}")
    return known


def _payload(path: Path, fields: dict[str, str], header_end: int) -> Payload:
    encoding = fields["encoding"].lower()
    before = whole("line skip", fields.get("line skip", "0"))
    skip = whole("byte skip", fields.get("byte skip", "0"))
    detached = "data file" in fields
    data = data_file(path, fields["data file"]) if detached else path
    if not 0 <= before <= _MOST_SKIPPED_LINES or skip < -1 or (skip == -1 and encoding not in _RAW):
        raise HeaderError(f"line skip = {before} and byte skip = {skip}")
    start = _after_lines(data, 0 if detached else header_end, before)
    if encoding in _PACKED:
        return Payload(path=data, offset=start, packed=True, skip=skip)
    if encoding in _RAW:
        return Payload(path=data, offset=start, skip=max(skip, 0))
    if encoding in _TEXT:
        return Payload(path=data, offset=start, text=True)
    raise HeaderError(f"encoding = {shown(encoding)}", "save it with the encoding raw or gzip")


def _after_lines(data: Path, start: int, count: int) -> int:
    """Where the bytes after so many lines begin."""
    if not count:
        return start
    with data.open("rb") as stream:
        stream.seek(start)
        for _ in zip(range(count), lines(stream), strict=False):
            pass
        return stream.tell()

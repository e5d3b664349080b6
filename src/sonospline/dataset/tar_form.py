"""WebDataset files: a plain tar, the files of a sample one after the other under its number."""

from __future__ import annotations

import io
import json
import struct
import tarfile
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..io.png import png
from .layout import ArrayForm
from .sample import Sample

PICTURE_DTYPE = "uint8"


def tar(samples: list[Sample], forms: Mapping[str, ArrayForm]) -> bytes:
    """Return samples as a tar: pictures as PNG, other arrays as NPY, the row as JSON. Equal samples, equal bytes."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for sample in samples:
            for suffix, content in _files(sample, forms):
                entry = tarfile.TarInfo(f"{sample.recipe.index:09d}.{suffix}")
                entry.size, entry.mode = len(content), 0o644
                archive.addfile(entry, io.BytesIO(content))
    return stream.getvalue()


def _files(sample: Sample, forms: Mapping[str, ArrayForm]) -> Iterator[tuple[str, bytes]]:
    for name, form in forms.items():
        array = sample.arrays[name]
        if form.dtype == PICTURE_DTYPE:
            yield f"{name}.png", png(array)
        else:
            yield f"{name}.npy", _npy(array)
    yield "json", json.dumps(sample.row).encode()


def _npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    return stream.getvalue()


def read_tar(content: bytes) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the number of each sample of a tar and what is there of it by name: arrays, and the row as ``row``."""
    number, held = None, dict[str, Any]()
    with tarfile.open(fileobj=io.BytesIO(content)) as archive:
        for entry in archive:
            stem, _, suffix = entry.name.partition(".")
            if number is not None and int(stem) != number:
                yield number, held
                held = {}
            number = int(stem)
            stream = archive.extractfile(entry)
            assert stream is not None
            name, kind = (suffix.rpartition(".")[0] or "row"), suffix.rpartition(".")[2]
            held[name] = _read(kind, stream.read())
    if number is not None:
        yield number, held


def _read(kind: str, content: bytes) -> Any:
    if kind == "json":
        return json.loads(content)
    if kind == "npy":
        return np.load(io.BytesIO(content), allow_pickle=False)
    return _pixels(content)


def _pixels(content: bytes) -> NDArray[np.uint8]:
    """Grey levels of a PNG as :func:`~sonospline.io.png.png` writes it: lines without filters."""
    try:
        columns, rows, *form = struct.unpack_from(">IIBBBBB", content, 16)
        length, name = struct.unpack_from(">I4s", content, 33)
        lines = np.frombuffer(zlib.decompress(content[41 : 41 + length]), np.uint8).reshape(rows, columns + 1)
    except (ValueError, struct.error, zlib.error):
        name = b""
    if name != b"IDAT" or form != [8, 0, 0, 0, 0] or lines[:, 0].any():
        raise ValueError("a picture of a shard was written by another program; make the shard again")
    return np.ascontiguousarray(lines[:, 1:])

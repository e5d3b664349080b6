"""The bytes of an image's voxels: where they are, and how many there really are."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..files import open_file
from .errors import HeaderError

_CHUNK, _LARGEST_PIECE, _FURTHER = 1 << 18, 1 << 22, 1 << 20
_MOST_EXPANSION = 1040
"""Bytes that deflate makes of one, at most, and some."""
_MOST_A_DIGIT = 8
"""Bytes of a voxel that one byte of text stands for, at most."""


@dataclass(frozen=True, kw_only=True)
class Payload:
    """Part of a file.

    Parameters
    ----------
    path : Path
        The file.
    offset : int
        Of the first byte.
    length : int, optional
        Bytes there, packed or not; by default up to the end.
    packed : bool, default: False
        Whether they are a zlib or gzip stream.
    text : bool, default: False
        Whether they are digits, which ITK counts by itself.
    skip : int, default: 0
        Bytes before the voxels, counted unpacked.
    """

    path: Path
    offset: int
    length: int | None = None
    packed: bool = False
    text: bool = False
    skip: int = 0

    @property
    def there(self) -> int:
        """Bytes in the file, packed or not."""
        there = max(0, self.path.stat().st_size - self.offset)
        return there if self.length is None else min(there, self.length)

    def held(self, wanted: int) -> int:
        """Return how many bytes of voxels there are, counted until there are as many as wanted.

        Raises
        ------
        HeaderError
            A compressed stream that is damaged or cut.
        """
        if self.text:
            return self.there * _MOST_A_DIGIT
        if not self.packed:
            return self.there - self.skip
        return sum(len(piece) for piece in self.pieces(wanted))

    def unpacked(self, wanted: int) -> NDArray[np.uint8]:
        """Return so many bytes of voxels of a compressed stream.

        Raises
        ------
        HeaderError
            A stream that is damaged or cut, or holds fewer.
        """
        unpacked, filled = np.empty(wanted, np.uint8), 0
        for piece in self.pieces(wanted):
            found = np.frombuffer(piece, np.uint8)[: wanted - filled]
            unpacked[filled : filled + len(found)] = found
            filled += len(found)
        if filled < wanted:
            raise HeaderError("fewer bytes than voxels")
        return unpacked

    def pieces(self, wanted: int) -> Iterator[bytes]:
        """Yield the voxels' bytes, unpacked, to their end; of a packed stream, to somewhat further than wanted.

        Raises
        ------
        HeaderError
            A compressed stream that is damaged or cut.
        """
        if self.packed and self.there * _MOST_EXPANSION < wanted:
            return
        skip, left = self.skip, wanted + _FURTHER
        with open_file(self.path, "volume", "the path of an image file") as stream:
            stream.seek(self.offset)
            for piece in (_unpacked if self.packed else _plain)(stream, self.there):
                yield piece[skip:]
                left -= max(0, len(piece) - skip)
                skip = max(0, skip - len(piece))
                if self.packed and left <= 0:  # what follows is nobody's
                    return


def unpack(stream: BinaryIO, wanted: int) -> bytes:
    """Return the first bytes of a gzip stream, as many as wanted or as there are."""
    try:
        return zlib.decompressobj(47).decompress(stream.read(wanted + _CHUNK), wanted)
    except zlib.error as error:
        raise HeaderError(str(error)) from None


def _plain(stream: BinaryIO, left: int) -> Iterator[bytes]:
    """What a stream holds, piece by piece."""
    while piece := stream.read(min(_CHUNK, left)):
        yield piece
        left -= len(piece)


def _unpacked(stream: BinaryIO, left: int) -> Iterator[bytes]:
    """What a zlib stream, or several gzip streams in a row, unpacks to, piece by piece."""
    unpacker, piece = zlib.decompressobj(47), b""
    while left or piece:
        if not piece:
            piece = stream.read(min(_CHUNK, left))
            left -= len(piece)
            if not piece:
                break
        try:
            yield unpacker.decompress(piece, _LARGEST_PIECE)
        except zlib.error as error:
            raise HeaderError(str(error)) from None
        piece = unpacker.unconsumed_tail
        if unpacker.eof:
            if unpacker.unused_data[:2] != b"\x1f\x8b":
                return
            unpacker, piece = zlib.decompressobj(31), unpacker.unused_data
    raise HeaderError("the compressed stream ends before its end")

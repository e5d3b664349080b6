"""Pictures as PNG, with nothing but zlib: notebooks show them without an extra."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_8_BIT, _GREY, _RGB = 8, 0, 2


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return grey levels (rows, columns), or colours (rows, columns, 3), as the bytes of a PNG file.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.io.png import png
    >>> png(np.zeros((2, 3), np.uint8))[:4]
    b'\\x89PNG'
    """
    rows, columns = pixels.shape[:2]
    lines = np.zeros((rows, 1 + pixels[0].size), np.uint8)  # each line begins with its filter: none
    lines[:, 1:] = pixels.reshape(rows, -1)
    header = struct.pack(">IIBBBBB", columns, rows, _8_BIT, _GREY if pixels.ndim == 2 else _RGB, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes())), (b"IEND", b"")
    return _SIGNATURE + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

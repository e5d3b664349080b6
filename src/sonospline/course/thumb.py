"""Small pictures of a station, for a card on the trainer's page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..server.wire import binary
from .trainer_messages import ThumbHeader

if TYPE_CHECKING:
    from ..simulator.console_frame import ConsoleFrame

THUMB = 3
"""Kind of the message."""
_WIDEST = 256
"""Pixels of a card."""


def thumb(station: str, shown: ConsoleFrame) -> bytes:
    """Return the message with a small picture: each pixel is the mean of a square of the frame's."""
    pixels = np.asarray(shown.image.pixels, np.uint8)
    rows, columns = pixels.shape
    side = max(1, -(-columns // _WIDEST))
    rows, columns = rows // side, columns // side
    squares = pixels[: rows * side, : columns * side].reshape(rows, side, columns, side)
    small = squares.mean(axis=(1, 3)).round().astype(np.uint8)
    return binary(THUMB, ThumbHeader(station=station, rows=rows, columns=columns), small.tobytes())

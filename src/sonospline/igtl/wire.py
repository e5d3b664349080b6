"""Bytes and what they hold: the reader that every body is read with, and fields of a fixed length."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._shown import shown
from .errors import ContentError, SizeError

SINGLE, DOUBLE = np.dtype(">f4"), np.dtype(">f8")


@cache
def layout(fields: str) -> struct.Struct:
    """Return the layout of big-endian fields without padding, as ``struct`` writes them."""
    return struct.Struct(">" + fields)


class Reader:
    """A body, read from its beginning to its end; whatever is missing is a SizeError.

    Parameters
    ----------
    body : bytes or memoryview
    what : str
        What errors call it.
    """

    def __init__(self, body: bytes | memoryview, what: str) -> None:
        self._body, self.what, self._at = memoryview(body), what, 0

    @property
    def left(self) -> int:
        """How many bytes were not read yet."""
        return len(self._body) - self._at

    def bytes(self, count: int) -> memoryview:
        """Take bytes."""
        if count > self.left:
            raise SizeError(f"{self.what} has {len(self._body)} bytes; it ends {shown(count - self.left)} too early")
        start, self._at = self._at, self._at + count
        return self._body[start : self._at]

    def fields(self, fields: str) -> tuple[Any, ...]:
        """Take numbers and fixed bytes."""
        known = layout(fields)
        return known.unpack(self.bytes(known.size))

    def array(self, kind: np.dtype[Any], *shape: int) -> NDArray[Any]:
        """Take an array, as one of its own in the machine's byte order."""
        count = 1
        for length in shape:
            count *= length
        found = np.frombuffer(self.bytes(count * kind.itemsize), kind).astype(kind.newbyteorder("="))
        return found.reshape(shape)

    def singles(self, *shape: int) -> NDArray[np.float32]:
        """Take finite numbers of 32 bits."""
        return finite(self.what, self.array(SINGLE, *shape))

    def text(self, size: int) -> str:
        """Take a text in a field of so many bytes, up to its first zero."""
        return text_of(self.bytes(size))

    def end(self) -> None:
        """Raise SizeError where something is left."""
        if self.left:
            raise SizeError(f"{self.what} has {len(self._body)} bytes; {self.left} more than its counts say")


def text_of(field: bytes | memoryview) -> str:
    """Return the text of a field, up to its first zero; what is no UTF-8 shows as such."""
    return bytes(field).partition(b"\0")[0].decode(errors="replace")


def finite(what: str, array: NDArray[Any]) -> NDArray[Any]:
    """Return numbers that are finite."""
    if not np.isfinite(array).all():
        raise ContentError(f"{what} holds NaN or infinity; finite numbers are expected")
    return array


def field(name: str, text: str, size: int) -> bytes:
    """Return a text as a field of so many bytes takes it, without its padding.

    Raises
    ------
    ValueError
        It is too long, or holds a zero.
    """
    if not isinstance(text, str):
        raise ValueError(f"{name} = {shown(text)} is not a text; give one")
    encoded = text.encode(errors="replace")
    if len(encoded) > size:
        raise ValueError(f"{name} = {shown(text)} has {len(encoded)} bytes; give at most {size}")
    if b"\0" in encoded:
        raise ValueError(f"{name} = {shown(text)} holds a zero, which ends a text on the wire; leave it out")
    return encoded


def singles(name: str, values: ArrayLike, *shape: int) -> NDArray[np.float32]:
    """Return finite numbers as the wire carries them, read-only; -1 in the shape is any length.

    Raises
    ------
    ValueError
        Another shape, or numbers that are not finite.
    """
    try:
        with np.errstate(over="ignore"):
            array = np.array(values, np.float32)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {shown(values)} is not numeric; give numbers") from None
    wanted = tuple(len_ if want < 0 else want for want, len_ in zip(shape, array.shape, strict=False))
    if array.shape != wanted or array.ndim != len(shape):
        sizes = " x ".join("n" if length < 0 else str(length) for length in shape)
        raise ValueError(f"{name} has shape {array.shape}; give {sizes} numbers")
    array.setflags(write=False)
    return finite(name, array)


def whole(name: str, value: int, most: int, least: int = 0) -> int:
    """Return a whole number within what its field holds."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise ValueError(f"{name} = {shown(value)} is out of range; give a whole number from {least} to {most}")
    return int(value)

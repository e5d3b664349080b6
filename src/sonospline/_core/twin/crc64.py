"""NumPy twin of the check of OpenIGTLink's messages: CRC-64 of ECMA-182, first bit first, from zero, not inverted."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.uint64]

POLYNOMIAL = np.uint64(0x42F0E1EBA9EA3693)
_ONE, _BYTE, _HIGHEST_BYTE, _HIGHEST = np.uint64(1), np.uint64(8), np.uint64(56), np.uint64(63)
_ALL = (1 << 64) - 1
_STRIP = 256
"""Bytes of a strip: all strips of a message are gone through at once."""
_FEW = 16 * _STRIP
"""Fewer bytes are faster one by one."""


def crc64(data: NDArray[np.uint8], start: int) -> int:
    """Return the check of bytes (n,) that follow others whose check is ``start``.

    As remainders of polynomials over GF(2) are, it is a sum: of strips of equal length, each of them with zeros behind
    it. Zeros in front change nothing, so that the first strip is filled up with them.
    """
    if len(data) < _FEW:
        return _byte_by_byte(data, start)
    if start:  # its check is that of its own eight bytes, times what follows
        return crc64(_with_start(data, start), 0)
    strips = np.zeros((max(1, -(-len(data) // _STRIP)), _STRIP), np.uint8)
    strips.reshape(-1)[strips.size - len(data) :] = data
    checks = np.zeros(len(strips), np.uint64)
    for column in np.ascontiguousarray(strips.T):
        checks = (checks << _BYTE) ^ _TABLE[(checks >> _HIGHEST_BYTE) ^ column]
    behind = _zeros_behind()
    while len(checks) > 1:
        if len(checks) % 2:
            checks = np.concatenate([np.zeros(1, np.uint64), checks])
        checks = _mapped(behind, checks[::2]) ^ checks[1::2]
        behind = _mapped(behind, behind)
    return int(checks[0])


def _with_start(data: NDArray[np.uint8], start: int) -> NDArray[np.uint8]:
    joined = data.copy()
    joined[:8] ^= np.frombuffer(start.to_bytes(8, "big"), np.uint8)
    return joined


def _byte_by_byte(data: NDArray[np.uint8], check: int) -> int:
    for byte in data.tobytes():
        check = (check << 8) & _ALL ^ _WHOLE_NUMBERS[check >> 56 ^ byte]
    return check


def _times_x(values: Numbers) -> Numbers:
    return (values << _ONE) ^ ((values >> _HIGHEST) * POLYNOMIAL)


def _table() -> Numbers:
    values = np.arange(256, dtype=np.uint64) << _HIGHEST_BYTE
    for _ in range(8):
        values = _times_x(values)
    return values


_TABLE = _table()
_WHOLE_NUMBERS = _TABLE.tolist()


@cache
def _zeros_behind() -> Numbers:
    """Where each bit of a check (64,) goes, lowest first, by the zeros of one strip."""
    bits: Numbers = _ONE << np.arange(64, dtype=np.uint64)
    for _ in range(_STRIP):
        bits = (bits << _BYTE) ^ _TABLE[bits >> _HIGHEST_BYTE]
    return bits


def _mapped(images: Numbers, values: Numbers) -> Numbers:
    """Return what a linear map, given by the images of the bits, makes of values."""
    result = np.zeros_like(values)
    for bit, image in enumerate(images):
        result ^= ((values >> np.uint64(bit)) & _ONE) * image
    return result

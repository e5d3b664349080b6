"""Time on the wire: seconds since 1970 (UTC) as a whole number of 2^-32 seconds, in 64 bits."""

from __future__ import annotations

import time

from .. import _validate

MOST_STAMP = (1 << 64) - 1
_SECOND, _NANOSECONDS = 1 << 32, 10**9


def now() -> int:
    """Return the stamp of this moment."""
    return stamp_of_ns(time.time_ns())


def stamp_of_ns(nanoseconds: int) -> int:
    """Return the stamp of a time as ``time.time_ns()`` gives it; time ends in 2106.

    Examples
    --------
    >>> from sonospline import igtl
    >>> hex(igtl.stamp_of_ns(1_500_000_000)), igtl.seconds_of(3 << 31)
    ('0x180000000', 1.5)
    """
    return (_validate.count("nanoseconds", nanoseconds, least=0) * _SECOND // _NANOSECONDS) & MOST_STAMP


def seconds_of(stamp: int) -> float:
    """Return a stamp in seconds since 1970; a float tells moments apart that are a quarter of a microsecond apart."""
    return stamp / _SECOND

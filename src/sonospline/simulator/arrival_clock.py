"""When the next wish will come: a picture begun a moment later may show a newer one."""

from __future__ import annotations

_WORTH_S = 0.010
"""A picture waits at most so long for a wish that is about to come."""
_GRACE_S = 0.0015
_FASTEST_S, _SLOWEST_S = 0.004, 0.04
"""Wishes further apart, or closer, are no stream to wait for."""
_UNEVEN = 0.35
"""Share by which an interval may differ from those before it."""


class Rhythm:
    """The beat of a stream of wishes.

    Where pictures take a little longer than wishes are apart, a picture begun at once would show a wish that is on
    average half an interval old. One that waits for the next wish, where that is due within 10 ms, shows it fresh.

    Examples
    --------
    >>> from sonospline.simulator.arrival_clock import Rhythm
    >>> rhythm = Rhythm()
    >>> for k in range(5):
    ...     rhythm.beat(k / 50)
    >>> rhythm.worth_waiting_until(4 / 50 + 0.005) is None    # 15 ms to go
    True
    >>> round(rhythm.worth_waiting_until(4 / 50 + 0.014), 4)  # 6 ms to go, and a little grace
    0.1015
    """

    def __init__(self) -> None:
        self._last = self._interval = 0.0
        self._even = 0

    def beat(self, now: float) -> None:
        """Take note that a wish came."""
        interval, self._last = now - self._last, now
        if _FASTEST_S <= interval <= _SLOWEST_S:
            even = abs(interval - self._interval) <= _UNEVEN * self._interval
            self._even = self._even + 1 if even else 0
            self._interval += (interval - self._interval) * (0.2 if even else 1.0)
        else:
            self._even = 0

    def worth_waiting_until(self, now: float) -> float | None:
        """Return until when a picture should wait for the next wish; None where it should begin."""
        due = self._last + self._interval
        if self._even < 2 or not now < due + _GRACE_S or due - now > _WORTH_S:
            return None
        return due + _GRACE_S

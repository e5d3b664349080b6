"""When the next command will come: a picture begun a moment later may show a newer one."""

from __future__ import annotations

_WORTH_S = 0.010
"""A picture waits at most so long for a command that is about to come."""
_GRACE_S = 0.0015
_FASTEST_S, _SLOWEST_S = 0.004, 0.04
"""Commands further apart, or closer, are no stream to wait for."""
_UNEVEN = 0.35
"""Share by which an interval may differ from those before it."""


class ArrivalClock:
    """The beat of a stream of commands.

    Where pictures take a little longer than commands are apart, a picture begun at once would show a command that is on
    average half an interval old. One that waits for the next command, where that is due within 10 ms, shows it fresh.

    Examples
    --------
    >>> from sonospline.simulator.arrival_clock import ArrivalClock
    >>> clock = ArrivalClock()
    >>> for k in range(5):
    ...     clock.beat(k / 50)
    >>> clock.worth_waiting_until(4 / 50 + 0.005) is None    # 15 ms to go
    True
    >>> round(clock.worth_waiting_until(4 / 50 + 0.014), 4)  # 6 ms to go, and a little grace
    0.1015
    """

    def __init__(self) -> None:
        self._last = self._interval = 0.0
        self._even = 0

    def beat(self, now: float) -> None:
        """Take note that a command came."""
        interval, self._last = now - self._last, now
        if _FASTEST_S <= interval <= _SLOWEST_S:
            even = abs(interval - self._interval) <= _UNEVEN * self._interval
            self._even = self._even + 1 if even else 0
            self._interval += (interval - self._interval) * (0.2 if even else 1.0)
        else:
            self._even = 0

    def worth_waiting_until(self, now: float) -> float | None:
        """Return until when a picture should wait for the next command; None where it should begin."""
        due = self._last + self._interval
        if self._even < 2 or not now < due + _GRACE_S or due - now > _WORTH_S:
            return None
        return due + _GRACE_S

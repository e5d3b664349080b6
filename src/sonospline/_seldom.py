"""Lines of a log that may come in any number, of which one a minute is enough."""

from __future__ import annotations

import logging
import threading
import time

LINES_APART_S = 60.0
_MOST_REMEMBERED = 256


class Seldom:
    """Says a line in a log, one a minute at most, and with it how many were left out before; from any thread.

    Where lines are about several (hosts, for example), each has its own minute; the last 256 are remembered.

    Parameters
    ----------
    logger : logging.Logger
    apart_s : float, default: 60

    Examples
    --------
    >>> import logging
    >>> from sonospline._seldom import Seldom
    >>> seldom = Seldom(logging.getLogger("example"))
    >>> for number in range(3):
    ...     seldom.say(f"refused: message {number}")
    >>> seldom.left_out
    2
    """

    def __init__(self, logger: logging.Logger, apart_s: float = LINES_APART_S) -> None:
        self._logger, self._apart_s, self._lock = logger, apart_s, threading.Lock()
        self._last: dict[str, tuple[float, int]] = {}

    def say(self, line: str, *, about: str = "", error: BaseException | None = None) -> None:
        """Say a line as a warning, with an error's traceback where one is given; or count it."""
        now = time.monotonic()
        with self._lock:
            last, left_out = self._last.pop(about, (-self._apart_s, 0))
            due = now - last >= self._apart_s
            self._last[about] = (now, 0) if due else (last, left_out + 1)
            if len(self._last) > _MOST_REMEMBERED:
                del self._last[next(iter(self._last))]
        if due:
            more = f" ({left_out} more since the last such line)" if left_out else ""
            self._logger.warning("%s%s", line, more, exc_info=error)

    @property
    def left_out(self) -> int:
        """Lines since the last ones that were said."""
        return sum(left_out for _, left_out in self._last.values())

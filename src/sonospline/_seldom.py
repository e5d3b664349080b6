"""Lines of a log that may come in any number, of which one a minute is enough."""

from __future__ import annotations

import logging
import threading
import time

LINES_APART_S = 60.0


class Seldom:
    """Says a line in a log, one a minute at most, and with it how many were left out before; from any thread.

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
        self._last = -apart_s
        self.left_out = 0
        """Lines since the last one that was said."""

    def say(self, line: str) -> None:
        """Say a line as a warning, or count it."""
        now = time.monotonic()
        with self._lock:
            if now - self._last < self._apart_s:
                self.left_out += 1
                return
            self._last, left_out, self.left_out = now, self.left_out, 0
        self._logger.warning("%s%s", line, f" ({left_out} more since the last such line)" if left_out else "")

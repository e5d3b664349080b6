"""What one client may do: messages a second, and refusals before it is hung up on."""

from __future__ import annotations

import time
from collections import deque

from .client_messages import MessageError

MOST_MESSAGES_S = 240
MOST_REFUSALS, REFUSALS_S = 20, 10.0


class RateLimits:
    """What one client did lately."""

    def __init__(self) -> None:
        self._refusals: deque[float] = deque(maxlen=MOST_REFUSALS)
        self._arrivals: deque[float] = deque(maxlen=MOST_MESSAGES_S)

    def count_message(self) -> None:
        """Count a message.

        Raises
        ------
        MessageError
            It came too fast after the others.
        """
        now = time.monotonic()
        if len(self._arrivals) == MOST_MESSAGES_S and now - self._arrivals[0] < 1:
            raise MessageError("message", f"came too fast; send at most {MOST_MESSAGES_S} a second")
        self._arrivals.append(now)

    def count_refusal(self) -> bool:
        """Count a refusal; return whether it was one too many."""
        now = time.monotonic()
        self._refusals.append(now)
        return len(self._refusals) == MOST_REFUSALS and now - self._refusals[0] < REFUSALS_S

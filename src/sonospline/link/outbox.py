"""What waits to be sent: the newest image wins, nothing else is lost without a word."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator

from .. import igtl

NEWEST_WINS = frozenset({"IMAGE", "POLYDATA"})
"""Types of which a newer message of the same device takes the place of one that waits."""
MOST_WAITING = 4096
"""Other messages that wait; with more, the oldest are lost, and counted."""

SENDER = "Sonospline"
"""Device name of what is said about the link itself."""

_Key = tuple[str, str] | int


class Outgoing:
    """A message on its way to several clients: its bytes are made once for each version of the header."""

    def __init__(self, message: igtl.Message) -> None:
        self.message, self.type = message, message.content.type
        self._encoded: dict[int, bytes] = {}

    def encoded(self, version: int) -> bytes:
        """Return its bytes."""
        if version not in self._encoded:
            self._encoded[version] = igtl.encode(self.message, version)
        return self._encoded[version]


def lost_notice(lost: int) -> Outgoing:
    """Return what says how many messages were lost before it."""
    return Outgoing(igtl.Message(igtl.Status(8, f"{lost} messages were lost", "Overflow"), SENDER, igtl.now()))


class Outbox:
    """Messages in the order they came, as many as may wait.

    Parameters
    ----------
    most : int, optional
    """

    def __init__(self, most: int = MOST_WAITING) -> None:
        self._most, self._number = most, 0
        self._waiting: OrderedDict[_Key, Outgoing] = OrderedDict()
        self.replaced = 0
        """Messages whose place a newer one took."""
        self.lost = 0
        """Messages lost since :meth:`said_lost` was called last."""

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, message: Outgoing) -> None:
        """Take a message; it may take the place of an older one, or that of the oldest."""
        key: _Key = (message.type, message.message.device)
        if message.type not in NEWEST_WINS:
            self._number += 1
            key = self._number
        if key in self._waiting:
            self.replaced += 1
        elif len(self._waiting) >= self._most:
            self._waiting.popitem(last=False)
            self.lost += 1
        self._waiting[key] = message

    def take(self) -> Outgoing:
        """Return what is to be sent next."""
        return self._waiting.popitem(last=False)[1]

    def said_lost(self) -> int:
        """Return how many messages were lost since the last call."""
        lost, self.lost = self.lost, 0
        return lost

    def __iter__(self) -> Iterator[Outgoing]:
        """Take all, one after the other."""
        while self._waiting:
            yield self.take()

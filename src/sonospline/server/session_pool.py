"""Places for sessions: those in use, and those kept for a page that may come back."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .connection import Connection
    from .kept_session import Kept

KEPT_S = 30.0
"""How long a session waits for a page that was reloaded or lost its socket."""


class SessionPool:
    """Sessions by their keys, no more than there are places; who is kept gives way to a newcomer.

    Everything happens in the socket's loop.

    Parameters
    ----------
    most : int
        Sessions at once, in use and kept.
    forgotten : callable
        Called when a kept session was given up.
    """

    def __init__(self, most: int, forgotten: Callable[[], None]) -> None:
        self.most, self._forgotten = most, forgotten
        self.connections: dict[str, Connection] = {}
        self._kept: dict[str, Kept] = {}  # the oldest first

    @property
    def full(self) -> bool:
        """Whether every place is in use."""
        return len(self.connections) >= self.most

    def add(self, key: str, connection: Connection) -> None:
        """Give a connection the place of a key."""
        self.connections[key] = connection
        while len(self.connections) + len(self._kept) > self.most:
            self._forget(next(iter(self._kept)))

    def remove(self, key: str, kept: Kept | None) -> None:
        """Free a connection's place; keep its session for a while where there is one to keep."""
        del self.connections[key]
        if kept is None:
            return
        self._kept[key] = kept
        asyncio.get_running_loop().call_later(KEPT_S, self._expire, key, kept)

    def reclaim(self, key: str) -> Kept | None:
        """Return the session kept under a key, which is kept no longer."""
        return self._kept.pop(key, None)

    def clear(self) -> None:
        """Give up every kept session."""
        for key in tuple(self._kept):
            self._forget(key)

    def _expire(self, key: str, kept: Kept) -> None:
        if self._kept.get(key) is kept:
            self._forget(key)

    def _forget(self, key: str) -> None:
        self._kept.pop(key).stage.close()
        self._forgotten()


def new_key() -> str:
    """Return a key that nobody guesses."""
    return secrets.token_urlsafe(16)

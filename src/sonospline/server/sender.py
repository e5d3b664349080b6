"""What is said to one client, from the socket's loop or from any thread."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from . import wire
from .outbox import Outbox
from .server_messages import Notice, ServerMessage


class Sender:
    """Puts messages into an outbox, in the loop it was made in.

    Parameters
    ----------
    outbox : Outbox
        Where messages to the client go, in order.
    on_full : callable
        Called when a message was lost: the client does not read.
    """

    def __init__(self, outbox: Outbox, on_full: Callable[[], None]) -> None:
        self._outbox, self._on_full = outbox, on_full
        self._loop = asyncio.get_running_loop()

    def say(self, message: ServerMessage) -> None:
        """Say a text."""
        self.put(wire.text(message))

    def put(self, message: str | bytes) -> None:
        """Send a message as it is."""
        if not self._outbox.put(message):
            self._on_full()

    def say_from_thread(self, message: ServerMessage) -> None:
        """Say a text, in any thread."""
        self.call(self.say, message)

    def report(self, line: str) -> None:
        """Tell of a fault, in any thread."""
        self.say_from_thread(Notice(level="fault", message=line))

    def call(self, function: Callable[[Any], object], argument: Any) -> None:
        """Have something done in the loop, from any thread; nothing where that has ended."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(function, argument)

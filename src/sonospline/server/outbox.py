"""What waits for a client to be read: a queue with an end."""

from __future__ import annotations

import asyncio

MOST = 64
"""Messages; frames are held back by credit long before."""
MOST_BYTES = 32 * 1024 * 1024
"""Some scenes' meshes."""


class Outbox:
    """Messages on their way to one client, in order.

    Parameters
    ----------
    most, most_bytes : int
        How much may wait for a client that does not read.
    """

    def __init__(self, most: int = MOST, most_bytes: int = MOST_BYTES) -> None:
        self._queue: asyncio.Queue[str | bytes] = asyncio.Queue(most)
        self._most_bytes, self._bytes = most_bytes, 0

    @property
    def is_empty(self) -> bool:
        """Whether the client has taken all that was said."""
        return self._queue.empty()

    def put(self, message: str | bytes) -> bool:
        """Add a message; False, and it is lost, where too much waits already."""
        if self._queue.full() or self._bytes + len(message) > self._most_bytes:
            return False
        self._queue.put_nowait(message)
        self._bytes += len(message)
        return True

    async def get(self) -> str | bytes:
        """Return the next message, once there is one."""
        message = await self._queue.get()
        self._bytes -= len(message)
        return message

    def texts(self) -> list[str]:
        """Take out everything and return the texts: frames are of no use to who is hung up on."""
        waiting = [self._queue.get_nowait() for _ in range(self._queue.qsize())]
        self._bytes = 0
        return [message for message in waiting if isinstance(message, str)]

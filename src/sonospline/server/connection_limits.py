"""How many are connected, and how long who says nothing: no more than the process can bear."""

from __future__ import annotations

import asyncio
import ipaddress
from collections import Counter
from typing import Any, NamedTuple

FIRST_REQUEST_S = 10.0
"""How long a connection may take for its first request."""
ANSWER_S = 60.0
"""How long an answer may take to be read."""
GOODBYE_S = 5.0
"""How long a WebSocket may take to close."""
MOST_PENDING = 128
_RESERVE = 64
"""Open files for everything else: images, the library's own."""
_FEWEST_PENDING = 8


class _Pending(NamedTuple):
    peer: str
    timer: asyncio.TimerHandle


class ConnectionLimits:
    """Connections that are no session: each has a time limit, and the longest silent one makes room for the next.

    A page's request comes within milliseconds, so whoever opens connections to fill the server up displaces only
    those of his own. Everything happens in the socket's loop.

    Parameters
    ----------
    most : int
        Such connections at once.
    """

    def __init__(self, most: int = MOST_PENDING) -> None:
        self.most = most
        self._pending: dict[asyncio.Transport, _Pending] = {}  # the longest silent first
        self._at: dict[Any, asyncio.Transport] = {}

    def opened(self, transport: asyncio.Transport) -> None:
        """Take in a connection; where there are too many, the longest silent one of the busiest peer ends."""
        self._at[_key(_address(transport))] = transport
        self._allow(transport, FIRST_REQUEST_S)

    def requested(self, address: Any) -> None:
        """Note a request: there is time for the answer."""
        transport = self._at.get(_key(address))
        if transport in self._pending:
            self._allow(transport, ANSWER_S)

    def upgraded(self, address: Any) -> asyncio.Transport | None:
        """Let a connection be a session's: it stays as long as it likes."""
        transport = self._at.get(_key(address))
        if transport in self._pending:
            self.closed(transport)
        return transport

    def closing(self, transport: asyncio.Transport) -> None:
        """Give a session's connection time to close, and no more."""
        self._allow(transport, GOODBYE_S)

    def closed(self, transport: asyncio.Transport) -> None:
        """Forget a connection."""
        entry = self._pending.pop(transport, None)
        if entry is not None:
            entry.timer.cancel()
        key = _key(_address(transport))
        if self._at.get(key) is transport:
            del self._at[key]

    @property
    def pending(self) -> int:
        """How many there are."""
        return len(self._pending)

    def _allow(self, transport: asyncio.Transport, seconds: float) -> None:
        old = self._pending.pop(transport, None)
        if old is not None:
            old.timer.cancel()
        timer = asyncio.get_running_loop().call_later(seconds, self._abort, transport)
        self._pending[transport] = _Pending(peer_of(_address(transport)), timer)
        if len(self._pending) > self.most:
            self._drop_one()

    def _drop_one(self) -> None:
        crowd = Counter(entry.peer for entry in self._pending.values())
        busiest = max(crowd, key=crowd.__getitem__)
        self._abort(next(transport for transport, entry in self._pending.items() if entry.peer == busiest))

    def _abort(self, transport: asyncio.Transport) -> None:
        self.closed(transport)
        transport.abort()


def pending_within(files: int | None, sessions: int) -> int:
    """Return how many connections may be pending beside some sessions, with so many open files at most.

    Raises
    ------
    ValueError
        Not even the sessions fit.
    """
    if files is None:
        return MOST_PENDING
    room = files - _RESERVE - sessions
    if room < _FEWEST_PENDING:
        most = files - _RESERVE - _FEWEST_PENDING
        remedy = f"give at most {most}, or raise" if most > 0 else "raise"
        raise ValueError(
            f"--sessions = {sessions} is more than {files} open files allow; {remedy} the limit (ulimit -n)"
        )
    return min(MOST_PENDING, room)


def open_files() -> int | None:
    """Return how many files this process may have open; None where nobody says."""
    try:
        import resource
    except ImportError:  # not a Unix
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return None if soft == resource.RLIM_INFINITY else soft


def _address(transport: asyncio.Transport) -> Any:
    return transport.get_extra_info("peername")


def _key(address: Any) -> Any:
    """The host and port of a peer: an IPv6 address has more parts."""
    return tuple(address[:2]) if address else None


def peer_of(address: Any) -> str:
    """Who that is: a host, or the network of an IPv6 host, who has many addresses."""
    if not address:
        return ""
    host = str(address[0]).partition("%")[0]
    try:
        return str(ipaddress.ip_network((host, 64), strict=False)) if ":" in host else host
    except ValueError:
        return host

"""One client of a :class:`LinkServer`: what came from it, what waits for it, and how long it may take."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import NamedTuple, Protocol, cast

from .. import igtl
from .outbox import SENDER, Outbox, Outgoing, lost_notice

PATIENCE_S = 5.0
"""How long a client may read nothing while something waits for it, and take for one message of its own."""
MOST_MESSAGES_S = 4096
"""Messages a second that are read of one client; those beyond wait in its socket."""
_AT_ONCE = 32
"""Messages of one client that are looked at before the others have their turn."""
_ARRAYS, _MOST_OF_OTHERS = frozenset({"IMAGE", "POLYDATA", "NDARRAY"}), 1 << 18
"""Types whose bytes are taken as they are; of every other type so many, for it is read entry by entry."""
_LONG = 1 << 14
"""After a body of more bytes the others have their turn."""
_SLOWEST_BYTES_S = 1e6
"""How fast a long message has to come."""
_BUFFERED = 1 << 16
_ON_REQUEST = frozenset({"TDATA", "QTDATA", "SENSOR", "NDARRAY"})
"""Types for whoever asked: they repeat what others say, and 3D Slicer calls each SENSOR and NDARRAY an error."""


class ClientInfo(NamedTuple):
    """One client of a server: its address, the header version it is answered with, and counts of messages."""

    address: str
    version: int
    sent: int
    received: int
    refused: int
    lost: int


class Limits(NamedTuple):
    """What a client may do."""

    newest_version: int
    most_bytes: int
    patience_s: float
    messages_s: int
    reads: frozenset[str] | None
    """Types that are read, queries apart; None for all that are known."""


class Host(Protocol):
    """What a connection belongs to."""

    def joined(self, connection: Connection) -> bool:
        """Take a new client; False where there are too many."""
        ...

    def left(self, connection: Connection) -> None:
        """Forget a client."""
        ...

    def received(self, connection: Connection, message: igtl.Message) -> None:
        """Take a message of a client."""
        ...

    def warn(self, connection: Connection, line: str) -> None:
        """Say in the log what a client did, seldom enough."""
        ...


class Connection(asyncio.Protocol):
    """One client. All of it happens in the thread of the server's loop; nothing in it waits."""

    def __init__(self, host: Host, limits: Limits) -> None:
        self._host, self._limits = host, limits
        self._loop = asyncio.get_running_loop()
        self._framer, self._outbox = igtl.Framer(limits.most_bytes), Outbox()
        self._flows: dict[str, float] = {}
        self._due: dict[tuple[str, str], float] = {}
        self._paused = self._resting = False
        self._stalled: asyncio.TimerHandle | None = None
        self._unfinished: asyncio.TimerHandle | None = None
        self._waits_for = 0
        self._second, self._in_second = 0.0, 0
        self._version, self._sent, self._received, self._refused, self._lost = 1, 0, 0, 0, 0
        self.host, self._address, self.last_sent = "?", "?", time.monotonic()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet a client, or send it away."""
        self._transport = cast(asyncio.Transport, transport)
        self._transport.set_write_buffer_limits(high=_BUFFERED)
        self.host, port, *_ = transport.get_extra_info("peername") or ("?", 0)
        self._address = f"{self.host}:{port}"
        if not self._host.joined(self):
            self._write(Outgoing(igtl.Message(igtl.Status(11, "too many clients", "Full"), SENDER)))
            self._transport.close()

    def connection_lost(self, problem: Exception | None) -> None:
        """Forget a client that is gone."""
        self._stop_waiting()
        if self._stalled is not None:
            self._stalled.cancel()
        self._paused = True
        self._host.left(self)

    @property
    def info(self) -> ClientInfo:
        """What can be said of it."""
        return ClientInfo(self._address, self._version, self._sent, self._received, self._refused, self._lost)

    def send(self, message: Outgoing) -> None:
        """Send a message as soon as the client reads, unless it does not want it."""
        if self._wants(message):
            self.answer(message)

    def answer(self, message: Outgoing) -> None:
        """Send a message as soon as the client reads."""
        self._outbox.put(message)
        self._flush()

    def answer_soon(self, message: igtl.Message) -> None:
        """Send a message as :meth:`answer` does, from any thread; nothing where the server has ended."""
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self.answer, Outgoing(message))

    def start(self, kind: str, interval_ms: int) -> None:
        """Send messages of a type, and no more often than that for each device."""
        self._flows[kind] = 1e-3 * interval_ms

    def stop(self, kind: str) -> None:
        """Send no messages of a type any more."""
        self._flows[kind] = -1.0

    def end(self) -> None:
        """End the connection, without a word."""
        self._transport.abort()

    def abort(self, why: str) -> None:
        """End the connection."""
        self._host.warn(self, f"{why}: hung up")
        self._transport.abort()

    # --- out

    def pause_writing(self) -> None:
        """Wait for a client that does not read."""
        self._paused = True
        self._watch(self._transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """Go on with one that does again."""
        self._paused = False
        if self._stalled is not None:
            self._stalled.cancel()
        self._flush()

    def _watch(self, waiting: int) -> None:
        self._stalled = self._loop.call_later(self._limits.patience_s, self._check_progress, waiting)

    def _check_progress(self, before: int) -> None:
        waiting = self._transport.get_write_buffer_size()
        if waiting >= before:
            self.abort(f"read nothing for {self._limits.patience_s:g} s")
        else:
            self._watch(waiting)

    def _wants(self, message: Outgoing) -> bool:
        interval = self._flows.get(message.type, -1.0 if message.type in _ON_REQUEST else 0.0)
        if interval <= 0:
            return interval == 0
        now, key = time.monotonic(), (message.type, message.message.device)
        if now < self._due.get(key, 0.0):
            return False
        self._due[key] = now + interval
        return True

    def _flush(self) -> None:
        while self._outbox and not (self._paused or self._transport.is_closing()):
            if lost := self._outbox.said_lost():
                self._lost += lost
                self._host.warn(self, f"{lost} messages were lost: it reads too slowly")
                self._write(lost_notice(lost))
            self._write(self._outbox.take())

    def _write(self, message: Outgoing) -> None:
        self._transport.write(message.encoded(self._version))
        self._sent += 1
        self.last_sent = time.monotonic()

    # --- in

    def data_received(self, data: bytes) -> None:
        """Take bytes of the client."""
        self._framer.feed(data)
        if not self._resting:
            self._read()

    def _read(self) -> None:
        for _ in range(_AT_ONCE):
            if self._transport.is_closing() or not self._may_read():
                return
            try:
                found = self._framer.next()
            except igtl.TooLargeError as error:
                self._refused += 1
                self.abort(str(error))
                return
            if found is None:
                self._wait_for_the_rest()
                return
            self._in_second += 1
            self._stop_waiting()
            self._take(*found)
            if len(found[1]) > _LONG:
                break
        self._rest(0.0)

    def _may_read(self) -> bool:
        """Whether it has messages left in this second; otherwise it has a rest until the next one."""
        now = self._loop.time()
        if now - self._second >= 1:
            self._second, self._in_second = now, 0
        if self._in_second < self._limits.messages_s:
            return True
        self._rest(self._second + 1 - now)
        return False

    def _rest(self, seconds: float) -> None:
        """Let others have their turn."""
        self._resting = True
        self._transport.pause_reading()
        self._loop.call_later(seconds, self._go_on)

    def _go_on(self) -> None:
        self._resting = False
        if not self._transport.is_closing():
            self._transport.resume_reading()
            self._read()

    def _wait_for_the_rest(self) -> None:
        """A message has its time from its first byte on; more of it where it is long."""
        if not self._framer.within or self._framer.announced != self._waits_for:
            self._stop_waiting()
        if self._framer.within and self._unfinished is None:
            self._waits_for = self._framer.announced
            seconds = self._limits.patience_s + self._waits_for / _SLOWEST_BYTES_S
            line = f"took more than {seconds:.3g} s for one message"
            self._unfinished = self._loop.call_later(seconds, self.abort, line)

    def _stop_waiting(self) -> None:
        if self._unfinished is not None:
            self._unfinished.cancel()
        self._unfinished, self._waits_for = None, 0

    def _take(self, header: igtl.Header, body: bytes) -> None:
        try:
            message = self._decoded(header, body)
        except igtl.WireError as error:
            self._refuse(str(error))
            if not isinstance(error, igtl.UnknownTypeError):
                return
            message = None
        self._version = max(self._version, min(self._limits.newest_version, header.version))
        if message is not None:
            self._received += 1
            self._host.received(self, message)

    def _decoded(self, header: igtl.Header, body: bytes) -> igtl.Message:
        reads = self._limits.reads
        if reads is not None and header.type not in reads and header.type[:4] not in ("GET_", "STT_", "STP_"):
            raise igtl.UnknownTypeError(f"{header.what} is of a type that is not read here")
        if header.type not in _ARRAYS and len(body) > _MOST_OF_OTHERS:
            raise igtl.SizeError(f"{header.what} has {len(body)} bytes; of its type {_MOST_OF_OTHERS} are read at most")
        return igtl.decode_body(header, body)

    def _refuse(self, line: str) -> None:
        self._refused += 1
        self._host.warn(self, f"refused: {line}")

    def __repr__(self) -> str:
        return f"Connection({self._address}, header version {self._version})"

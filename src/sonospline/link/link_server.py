"""A server of OpenIGTLink: many clients, each as fast as it reads."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable

from .. import _validate, igtl
from .._seldom import Seldom
from .link_connection import MOST_MESSAGES_S, PATIENCE_S, ClientInfo, Connection, Limits
from .outbox import SENDER, Outbox, Outgoing, lost_notice

logger = logging.getLogger(__name__)

PORT = 18944
"""Where scanners, PLUS and 3D Slicer are looked for."""
NEWEST_VERSION = 2
KEEP_ALIVE_S = 0.25
"""As PLUS does."""
_MOST_KEPT = 512
"""Newest messages that are kept for those who ask, by type and device."""
_BACKLOG = 16
_PAUSE_S = 1.0
_TURNS = 5
"""Turns of the loop until a transport has ended: two, and some more."""

Receive = Callable[[igtl.Message, Connection], Iterable[igtl.Message]]


class LinkServer:
    """Sends messages to all who are connected, and takes theirs; in a thread of its own.

    Every client is answered in header version 1 until it has sent 2 itself. Of images and meshes the newest wins where
    a client is slow; of what else it loses a STATUS gives the number. A client that reads nothing for a while, or takes
    too long for one message, is hung up on; none delays another. ``GET_`` is answered by the newest message, ``STT_``
    and ``STP_`` start and stop types for one client (TDATA, QTDATA, SENSOR, NDARRAY flow only then), and a STATUS says
    that the server lives.

    Parameters
    ----------
    port : int, default: 18944
        0 takes a free one: see :attr:`port`.
    host : str, default: "127.0.0.1"
        Whom it listens to: with another address than this machine's own, whoever reaches it.
    receive : callable, optional
        Called as ``receive(message, client)`` with everything but queries, in the server's thread; it returns messages
        to answer that client with, and must not take long.
    reads : iterable of str, optional
        Types that ``receive`` wants (``"TRANSFORM"``); others are skipped unread.
    greet : callable, optional
        Called when a client has come, in the server's thread.
    clients : int, default: 16
        At once, at most.
    keep_alive_s : float, default: 0.25
        After so long without a message a client is sent a STATUS.
    patience_s : float, default: 5
        How long a client may read nothing, and take for one message of its own.
    messages_s : int, default: 4096
        Messages a second that are read of one client.
    most_bytes : int, default: 64 MiB
        Bytes of a body that are taken.

    Raises
    ------
    ValueError
        Numbers out of range, a port in use, or an address that is not this machine's.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline import igtl
    >>> from sonospline.link import LinkServer
    >>> with LinkServer(port=0) as server:
    ...     server.publish(igtl.Message(igtl.Transform(np.eye(4)), "ProbeToReference", igtl.now()))
    ...     server.clients
    ()
    """

    def __init__(
        self,
        port: int = PORT,
        *,
        host: str = "127.0.0.1",
        receive: Receive | None = None,
        reads: Iterable[str] | None = None,
        greet: Callable[[], object] | None = None,
        clients: int = 16,
        keep_alive_s: float = KEEP_ALIVE_S,
        patience_s: float = PATIENCE_S,
        messages_s: int = MOST_MESSAGES_S,
        most_bytes: int = 1 << 26,
    ) -> None:
        self._receive, self._greet, self._most = receive, greet, _validate.count("clients", clients)
        self._limits = Limits(
            NEWEST_VERSION, _validate.count("most_bytes", most_bytes),
            _validate.number("patience_s", patience_s, positive=True), _validate.count("messages_s", messages_s),
            None if reads is None else frozenset(reads),
        )  # fmt: skip
        self._keep_alive_s = _validate.number("keep_alive_s", keep_alive_s, positive=True)
        self._socket = _bound(host, _validate.count("port", port, least=0, most=65_535))
        self.host, self.port = host, self._socket.getsockname()[1]
        self._connections: tuple[Connection, ...] = ()
        self._latest: OrderedDict[tuple[str, str], Outgoing] = OrderedDict()
        self._inbox, self._lock, self._woken = Outbox(), threading.Lock(), False
        self._joining: set[asyncio.Task[object]] = set()
        self._loop, self._ending = asyncio.new_event_loop(), asyncio.Event()
        self._closed = False
        self._seldom, self._failures = Seldom(logger), Seldom(logger)
        self._thread = threading.Thread(target=self._run, name=f"link {host}:{self.port}", daemon=True)
        self._thread.start()

    def publish(self, *messages: igtl.Message) -> None:
        """Send messages to all clients that want them; from any thread, without waiting."""
        with self._lock:
            for message in messages:
                self._inbox.put(Outgoing(message))
            if self._woken or self._closed:
                return
            self._woken = True
            self._loop.call_soon_threadsafe(self._send)

    @property
    def clients(self) -> tuple[ClientInfo, ...]:
        """Who is connected."""
        return tuple(connection.info for connection in self._connections)

    def close(self) -> None:
        """Hang up on all, and let the port go; a second time does nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()

    def __enter__(self) -> LinkServer:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"LinkServer({self.host}:{self.port}, {len(self._connections)} clients)"

    # --- what a connection calls

    def joined(self, connection: Connection) -> bool:
        """Take a new client; False where there are too many."""
        if len(self._connections) >= self._most:
            self.warn(connection, f"sent away: {self._most} clients are connected already")
            return False
        self._connections = (*self._connections, connection)
        if self._greet is not None:
            self._greet()
        return True

    def left(self, connection: Connection) -> None:
        """Forget a client."""
        self._connections = tuple(one for one in self._connections if one is not connection)

    def received(self, connection: Connection, message: igtl.Message) -> None:
        """Answer a query, and hand on everything else."""
        try:
            answers = self._answers(connection, message)
        except Exception as error:  # of whoever receives: the link goes on
            self._failures.say(f"{connection}: {message!r} was not taken: {error}", error=error)
            return
        for answer in answers:
            connection.answer(Outgoing(answer))

    def warn(self, connection: Connection, line: str) -> None:
        """Say in the log what a client did: one line a minute for each host, however often it comes again."""
        self._seldom.say(f"{connection.info.address}: {line}", about=connection.host)

    # --- the loop's thread

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        """Take clients until the end; a server of asyncio's own leaves those open that it has just accepted then."""
        self._socket.setblocking(False)
        self._loop.add_reader(self._socket, self._accept)
        keeping_alive = self._loop.create_task(self._keep_alive())
        await self._ending.wait()
        keeping_alive.cancel()
        self._loop.remove_reader(self._socket)
        self._socket.close()
        await asyncio.gather(*self._joining, return_exceptions=True)
        for connection in self._connections:
            connection.end()
        for _ in range(_TURNS):
            await asyncio.sleep(0)

    def _accept(self) -> None:
        try:
            accepted, _ = self._socket.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError as error:  # of too many open files, which would come again at once
            self._failures.say(f"a client cannot be taken: {error.strerror}")
            self._loop.remove_reader(self._socket)
            self._loop.call_later(_PAUSE_S, self._accept_again)
            return
        accepted.setblocking(False)
        joining = self._loop.create_task(
            self._loop.connect_accepted_socket(lambda: Connection(self, self._limits), accepted)
        )
        self._joining.add(joining)
        joining.add_done_callback(self._joining.discard)

    def _accept_again(self) -> None:
        if not self._ending.is_set():
            self._loop.add_reader(self._socket, self._accept)

    def _send(self) -> None:
        with self._lock:
            self._woken = False
            messages = list(self._inbox)
            lost = self._inbox.said_lost()
        if lost:
            self._failures.say(f"{lost} messages were lost before they were sent: they are published too fast")
            messages.insert(0, lost_notice(lost))
        for message in messages:
            self._keep(message)
            for connection in self._connections:
                connection.send(message)

    def _keep(self, message: Outgoing) -> None:
        key = (message.type, message.message.device)
        self._latest[key] = message
        self._latest.move_to_end(key)
        if len(self._latest) > _MOST_KEPT:
            self._latest.popitem(last=False)

    async def _keep_alive(self) -> None:
        while True:
            await asyncio.sleep(self._keep_alive_s)
            now, alive = time.monotonic(), Outgoing(igtl.Message(igtl.Status(), SENDER, igtl.now()))
            for connection in self._connections:
                if now - connection.last_sent >= self._keep_alive_s:
                    connection.send(alive)

    def _answers(self, connection: Connection, message: igtl.Message) -> Iterable[igtl.Message]:
        match message.content:
            case igtl.Get() as query:
                return [self._newest(query.of, message.device)]
            case igtl.Start() as query:
                connection.start(query.of, query.interval_ms)
                return [igtl.Message(igtl.Reply(query.of), message.device, igtl.now())]
            case igtl.Stop() as query:
                connection.stop(query.of)
                return [igtl.Message(igtl.Reply(query.of), message.device, igtl.now())]
        return () if self._receive is None else self._receive(message, connection)

    def _newest(self, kind: str, device: str) -> igtl.Message:
        """The newest message of a type, of a device or, without its name, of any."""
        if kind == "STATUS":
            return igtl.Message(igtl.Status(), device or SENDER, igtl.now())
        if kind == "CAPABILITY":
            return igtl.Message(igtl.Capability(tuple(igtl.CONTENTS)), device or SENDER, igtl.now())
        for (type_, name), kept in reversed(self._latest.items()):
            if type_ == kind and device in ("", name):
                return kept.message
        return igtl.Message(igtl.Nothing(kind), device, igtl.now())


def _bound(host: str, port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be listened on ({error.strerror})"
        raise ValueError(f"port = {port} on {host} {reason}; give another one, or 0 for any free one") from None
    made.listen(_BACKLOG)
    return made

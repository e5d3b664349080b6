"""A client of an OpenIGTLink server: it connects, and connects again, and hands on what comes."""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Callable, Iterable

from .. import _validate, igtl
from .._seldom import Seldom

logger = logging.getLogger(__name__)

_CONNECT_S, _LOOK_S = 2.0, 0.2
_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 2.0
_CHUNK = 1 << 18


class LinkClient:
    """Listens to a server, in a thread of its own; where it is not there or hangs up, it is tried again.

    Parameters
    ----------
    host, port : str, int
        Of the server: a tracker, PLUS, 3D Slicer.
    receive : callable
        Called with each message, one after the other. What it raises as a ValueError is said in the log.
    version : {2, 1}, default: 2
        Of the headers it sends. A server sends metadata, such as whether a tool is seen, only to who has sent 2; one
        that knows 1 alone may lose its way.
    says : iterable of Message, optional
        What it sends first: STT_TDATA, for example.
    reads : iterable of str, optional
        Types that are wanted; others are skipped unread.
    most_bytes : int, default: 64 MiB

    Examples
    --------
    >>> import threading
    >>> import numpy as np
    >>> from sonospline import igtl
    >>> from sonospline.link import LinkServer
    >>> from sonospline.tracking import LinkClient
    >>> came = threading.Event()
    >>> pose = igtl.Message(igtl.Transform(np.eye(4)), "NeedleToTracker", igtl.now())
    >>> with LinkServer(port=0, keep_alive_s=0.01) as server:
    ...     with LinkClient("127.0.0.1", server.port, lambda message: came.set()):
    ...         came.wait(10)
    True
    """

    def __init__(
        self,
        host: str,
        port: int,
        receive: Callable[[igtl.Message], object],
        *,
        version: int = 2,
        says: Iterable[igtl.Message] = (),
        reads: Iterable[str] | None = None,
        most_bytes: int = 1 << 26,
    ) -> None:
        self.host, self.port = host, _validate.count("port", port, least=1, most=65_535)
        self._receive, self._version, self._most = receive, version, _validate.count("most_bytes", most_bytes)
        first = igtl.Message(igtl.Get("STATUS"), "", igtl.now())
        self._hello = b"".join(igtl.encode(message, version) for message in (first, *says))
        self._reads = None if reads is None else frozenset(reads)
        self._ending, self._seldom, self._failures = threading.Event(), Seldom(logger), Seldom(logger)
        self.connected = False
        """Whether the server is there."""
        self.received = 0
        """Messages handed on."""
        self._thread = threading.Thread(target=self._run, name=f"link to {host}:{port}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hang up."""
        self._ending.set()
        self._thread.join()

    def __enter__(self) -> LinkClient:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"LinkClient({self.host}:{self.port}, {'connected' if self.connected else 'not connected'})"

    def _run(self) -> None:
        pause = _PAUSE_S
        while not self._ending.is_set():
            try:
                with socket.create_connection((self.host, self.port), _CONNECT_S) as stream:
                    self.connected, pause = True, _PAUSE_S
                    self._listen(stream)
            except (OSError, igtl.WireError) as error:
                self._seldom.say(f"{self.host}:{self.port}: {error}; tried again")
            self.connected = False
            self._ending.wait(pause)
            pause = min(2 * pause, _LONGEST_PAUSE_S)

    def _listen(self, stream: socket.socket) -> None:
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        stream.sendall(self._hello)
        stream.settimeout(_LOOK_S)
        framer = igtl.Framer(self._most)
        while not self._ending.is_set():
            try:
                data = stream.recv(_CHUNK)
            except TimeoutError:
                continue
            if not data:
                raise ConnectionError("the server hung up")
            framer.feed(data)
            while (found := framer.next()) is not None:
                self._take(*found)

    def _take(self, header: igtl.Header, body: bytes) -> None:
        if self._reads is not None and header.type not in self._reads:
            return
        try:
            message = igtl.decode_body(header, body)
            self._receive(message)
        except ValueError as error:
            self._seldom.say(f"{self.host}:{self.port}: refused: {error}")
        except Exception as error:  # of whoever receives: the link goes on
            self._failures.say(f"{self.host}:{self.port}: {header.device!r} was not taken: {error}", error=error)
        else:
            self.received += 1

"""The web server: one page, one WebSocket a session."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from .._extras import require
from .connection import GOING_AWAY, POLICY, Connection, MisbehaviourError
from .guard import Guard
from .library import Library
from .messages import LONGEST
from .scene_file import scene_schema

logger = logging.getLogger(__name__)

PAGE = Path(__file__).parent / "page"
TOO_MANY = 1013
_IDLE_CHECK_S = 1.0
_SHUTDOWN_S = 3
_OUTBOX = 64
"""Messages that may wait for a client that does not read; frames are held back by credit long before."""

NO_PAGE = """<!doctype html><meta charset="utf-8"><title>Sonospline</title>
<h1>The page was not built</h1>
<p>The simulator runs; its WebSocket is at <code>/live</code>. To build the page, run <code>make run</code> in the
sources, which needs Node.js 18 or newer; or install a wheel, which has the page in it.</p>
"""


class Server:
    """The simulator's web server, to be run in this thread or in another.

    Parameters
    ----------
    library : Library
        The scenes on offer.
    host, port : str, int
        Where to listen; port 0 takes a free one.
    token : str, optional
        Demanded of every session; needed for a host that is not loopback.
    sessions : int, default: 8
        Sessions at once, at most.
    idle_s : float, default: 1800
        A session nobody asks anything of for so long is closed.

    Raises
    ------
    ValueError
        A port in use, or an open host without a token.
    """

    def __init__(
        self,
        library: Library,
        *,
        host: str = "127.0.0.1",
        port: int = 8765,
        token: str | None = None,
        sessions: int = 8,
        idle_s: float = 1800.0,
    ) -> None:
        self._uvicorn = require("uvicorn")
        require("websockets")
        Guard(host, port, token)  # before the socket
        self.socket = _listen(host, port)
        self.host, self.port = host, self.socket.getsockname()[1]
        self.guard = Guard(host, self.port, token)
        self.library, self.most, self.idle_s = library, sessions, idle_s
        self.connections: set[Connection] = set()
        self._server = self._uvicorn.Server(
            self._uvicorn.Config(
                self._application(), log_config=None, access_log=False, ws="websockets-sansio", ws_max_size=LONGEST,
                ws_per_message_deflate=False, ws_ping_interval=20.0, ws_ping_timeout=20.0, lifespan="on",
                timeout_graceful_shutdown=_SHUTDOWN_S, server_header=False,
            )
        )  # fmt: skip

    @property
    def address(self) -> str:
        """Where the page is."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        query = f"/?token={self.guard.token}" if self.guard.token else "/"
        return f"http://{host}:{self.port}{query}"

    def run(self, ready: Callable[[str], None] = lambda address: None) -> None:
        """Serve until told to stop; ``ready`` is called with the address once pages can be opened."""
        self._ready = ready
        self._server.run(sockets=[self.socket])

    def stop(self) -> None:
        """Have :meth:`run` return soon; from any thread."""
        self._server.should_exit = True

    def _application(self) -> Any:
        require("starlette")
        from starlette.applications import Starlette
        from starlette.middleware import Middleware
        from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse
        from starlette.routing import Mount, Route, WebSocketRoute
        from starlette.staticfiles import StaticFiles

        async def schema(request: Any) -> Any:
            return JSONResponse(scene_schema())

        async def health(request: Any) -> Any:
            return PlainTextResponse("ok")

        async def no_page(request: Any) -> Any:
            return HTMLResponse(NO_PAGE, status_code=503)

        routes: list[Any] = [
            WebSocketRoute("/live", self._live),
            Route("/api/scene-schema.json", schema),
            Route("/healthz", health),
        ]
        if (PAGE / "index.html").is_file():
            routes.append(Mount("/", StaticFiles(directory=PAGE, html=True)))
        else:
            routes.append(Route("/", no_page))
        return Starlette(routes=routes, middleware=[Middleware(_Doorkeeper, guard=self.guard)], lifespan=self._life)

    @asynccontextmanager
    async def _life(self, app: Any) -> AsyncIterator[None]:
        self.library.prepare()
        watch = asyncio.create_task(self._tell_when_listening())
        yield
        watch.cancel()
        await asyncio.gather(*(connection.close() for connection in set(self.connections)))
        self.library.close()

    async def _tell_when_listening(self) -> None:
        while not self._server.started:
            await asyncio.sleep(0.005)
        self._ready(self.address)

    async def _live(self, websocket: Any) -> None:
        await websocket.accept()
        refusal = self.guard.refusal(websocket.headers, websocket.query_params.get("token"))
        if refusal is not None:
            await websocket.close(POLICY, refusal)
            return
        if len(self.connections) >= self.most:
            await websocket.close(TOO_MANY, f"{self.most} sessions are open; close one")
            return
        outbox: asyncio.Queue[str | bytes] = asyncio.Queue(_OUTBOX)
        connection = Connection(self.library, outbox)
        self.connections.add(connection)
        try:
            await self._converse(websocket, connection, outbox)
        finally:
            await connection.close()
            self.connections.discard(connection)

    async def _converse(self, websocket: Any, connection: Connection, outbox: asyncio.Queue[str | bytes]) -> None:
        """Take, send and watch the clock, until one of them ends."""
        tasks = [
            asyncio.create_task(work)
            for work in (_take(websocket, connection), _send(websocket, outbox), self._watch(connection))
        ]
        await connection.open()
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for task in done:
            problem = None if task.cancelled() else task.exception()
            if isinstance(problem, MisbehaviourError):
                await _flush(websocket, outbox)
                await _hang_up(websocket, problem)
            elif problem is not None:
                logger.debug("a client left: %r", problem)

    async def _watch(self, connection: Connection) -> None:
        while connection.idle_s() < self.idle_s:
            if connection.deaf:
                raise MisbehaviourError(POLICY, "messages are not read")
            await asyncio.sleep(min(_IDLE_CHECK_S, self.idle_s))
        raise MisbehaviourError(GOING_AWAY, "idle")


class _Doorkeeper:
    """Answers requests under a foreign name with 421, whatever they ask for; WebSockets are looked at once open."""

    def __init__(self, app: Any, guard: Guard) -> None:
        self._app, self._guard = app, guard

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            headers = {key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]}
            foreign = self._guard.foreign_host(headers)
            if foreign:
                from starlette.responses import PlainTextResponse

                await PlainTextResponse(foreign + "\n", status_code=421)(scope, receive, send)
                return
        await self._app(scope, receive, send)


async def _take(websocket: Any, connection: Connection) -> None:
    while True:
        event = await websocket.receive()
        if event["type"] == "websocket.disconnect":
            return
        await connection.take(event.get("text"))


async def _send(websocket: Any, outbox: asyncio.Queue[str | bytes]) -> None:
    while True:
        await _send_one(websocket, await outbox.get())


async def _send_one(websocket: Any, message: str | bytes) -> None:
    if isinstance(message, str):
        await websocket.send_text(message)
    else:
        await websocket.send_bytes(message)


async def _flush(websocket: Any, outbox: asyncio.Queue[str | bytes]) -> None:
    """Send the refusals that led to a hang-up; frames are of no use any more."""
    while not outbox.empty():
        message = outbox.get_nowait()
        if isinstance(message, str):
            await _send_one(websocket, message)


async def _hang_up(websocket: Any, problem: MisbehaviourError) -> None:
    try:
        await websocket.close(problem.code, problem.reason)
    except RuntimeError:  # it has left meanwhile
        logger.debug("a client left before it was hung up on")


def _listen(host: str, port: int) -> socket.socket:
    if not 0 <= port < 65536:
        raise ValueError(f"--port = {port} is out of range; give 0 to 65535")
    try:
        return socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be listened on ({error.strerror})"
        raise ValueError(f"--port = {port} on {host} {reason}; give another one, or 0 for any free one") from None

"""The web server: one page, one WebSocket a session."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from .. import simulator
from .._extras import require
from .access import AccessMiddleware, token_of
from .client_messages import LONGEST
from .connection import Connection
from .connection_limits import ConnectionLimits, open_files, pending_within
from .conversation import converse, hang_up
from .guard import Guard
from .kept_session import Kept
from .live_session import Watch
from .outbox import Outbox
from .protocols import http_protocol, websocket_protocol
from .scene_catalog import SceneCatalog
from .schema import protocol_schema
from .seat import Seat
from .session_pool import SessionPool, new_key
from .speaker import TAKEN_OVER, Verdict

logger = logging.getLogger(__name__)

PAGE = Path(__file__).parent / "page"
TOO_MANY = 1013
PING_S = 20.0
"""Between two questions whether a client is still there, and until it has to answer."""
_SHUTDOWN_S = 3
_BACKLOG = 128
"""Connections that may wait to be taken in, which then happens all at once."""
_HANDOVER_S = 10.0
"""How long a page waits for the socket before it to leave the session."""

NO_PAGE = """<!doctype html><meta charset="utf-8"><title>Sonospline</title>
<h1>The page was not built</h1>
<p>The simulator runs; its WebSocket is at <code>/live</code>. To build the page, run <code>./run</code> in the
sources, which needs Node.js 18 or newer; or install a wheel, which has the page in it.</p>
"""


class Server:
    """The simulator's web server, to be run in this thread or in another.

    Parameters
    ----------
    catalog : SceneCatalog
        The scenes on offer.
    host, port : str, int
        Where to listen; port 0 takes a free one.
    token : str, optional
        Demanded of every session; needed for a host that is not loopback.
    sessions : int, default: 8
        Sessions at once, at most.
    idle_s : float, default: 1800
        A session nobody asks anything of for so long is closed.
    watch : callable, optional
        Called with the runner of every session that begins: :meth:`PageLink.watch <sonospline.link.PageLink.watch>`.

    Raises
    ------
    ValueError
        A port in use, or an open host without a token.
    """

    def __init__(
        self,
        catalog: SceneCatalog,
        *,
        host: str = "127.0.0.1",
        port: int = 8765,
        token: str | None = None,
        sessions: int = 8,
        idle_s: float = 1800.0,
        watch: Watch | None = None,
    ) -> None:
        self._uvicorn = require("uvicorn")
        require("websockets")
        Guard(host, port, token)  # before the socket
        self.limits = ConnectionLimits(pending_within(open_files(), sessions))
        self.socket = _listen(host, port)
        self.host, self.port = host, self.socket.getsockname()[1]
        self.guard = Guard(host, self.port, token)
        self.catalog, self.idle_s, self._watch = catalog, idle_s, watch
        self.pool = SessionPool(sessions, catalog.release_memory)
        self._server = self._uvicorn.Server(
            self._uvicorn.Config(
                AccessMiddleware(self._application(), self.guard, self.limits.requested),
                http=http_protocol(self.limits), ws=websocket_protocol(self.limits), ws_max_size=LONGEST,
                ws_per_message_deflate=False, ws_ping_interval=PING_S, ws_ping_timeout=PING_S, lifespan="on",
                log_config=None, access_log=False, proxy_headers=False, server_header=False, backlog=_BACKLOG,
                timeout_graceful_shutdown=_SHUTDOWN_S,
            )
        )  # fmt: skip

    @property
    def address(self) -> str:
        """Where the page is."""
        return self.guard.address

    @property
    def connections(self) -> set[Connection]:
        """Who is connected."""
        return set(self.pool.connections.values())

    def run(self, ready: Callable[[str], None] = lambda address: None) -> None:
        """Serve until stopped; ``ready`` is called with the address once pages can be opened."""
        self._ready = ready
        self._server.run(sockets=[self.socket])

    def stop(self) -> None:
        """Have :meth:`run` return soon; from any thread."""
        self._server.should_exit = True

    def _application(self) -> Any:
        require("starlette")
        from starlette.applications import Starlette
        from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse
        from starlette.routing import Mount, Route, WebSocketRoute
        from starlette.staticfiles import StaticFiles

        async def schema(request: Any) -> Any:
            return JSONResponse(simulator.scene_schema())

        async def protocol(request: Any) -> Any:
            return JSONResponse(protocol_schema())

        async def health(request: Any) -> Any:
            return PlainTextResponse("ok")

        async def why_not(request: Any) -> Any:
            refusal = self.guard.refusal(request.headers, token_of(request.scope))
            if refusal is not None:
                return PlainTextResponse(refusal, 403)
            if self.pool.full:
                return PlainTextResponse(self._too_many, 503)
            return upgrade_required()

        async def no_page(request: Any) -> Any:
            return HTMLResponse(NO_PAGE, status_code=503)

        routes: list[Any] = [
            WebSocketRoute("/live", self._live),
            Route("/live", why_not),
            Route("/api/scene-schema.json", schema),
            Route("/api/protocol-schema.json", protocol),
            Route("/healthz", health),
            *self.more_routes(),
        ]
        if (PAGE / "index.html").is_file():
            routes.append(Mount("/", StaticFiles(directory=PAGE, html=True)))
        else:
            routes.append(Route("/", no_page))
        return Starlette(routes=routes, lifespan=self._life)

    def more_routes(self) -> list[Any]:
        """Return what else is served, before the page."""
        return []

    def seat(self, asked: str, key: str) -> Seat | str:
        """Return the seat for a page that asks for one by name or has a session's key, or why there is none."""
        return Seat()

    @asynccontextmanager
    async def _life(self, app: Any) -> AsyncIterator[None]:
        self.catalog.prepare()
        watch = asyncio.create_task(self._tell_when_listening())
        yield
        watch.cancel()
        self.pool.clear()
        await asyncio.to_thread(self.catalog.close)

    async def _tell_when_listening(self) -> None:
        while not self._server.started:
            await asyncio.sleep(0.005)
        self._ready(self.address)

    @property
    def _too_many(self) -> str:
        return f"{self.pool.most} sessions are open; close one"

    async def _live(self, websocket: Any) -> None:
        """Serve one WebSocket that the guard let in."""
        await websocket.accept()
        key = websocket.query_params.get("session", "")
        seat = self.seat(websocket.query_params.get("station", ""), key)
        if isinstance(seat, str):
            return await hang_up(websocket, Verdict(TOO_MANY, seat))
        kept = await self._reclaim(key)
        if self.pool.full:
            return await hang_up(websocket, Verdict(TOO_MANY, self._too_many))
        transport = self.limits.upgraded(websocket.scope["client"])
        outbox = Outbox()
        connection = Connection(
            self.catalog, outbox, new_key() if kept is None else key, watch=self._watch, seat=seat
        )  # fmt: skip
        self.pool.add(connection.key, connection)
        try:
            connection.open(kept)
            await converse(websocket, connection, outbox, transport, idle_s=self.idle_s)
        finally:
            if transport is not None:
                self.limits.closing(transport)
            await self._part(connection)

    async def _part(self, connection: Connection) -> None:
        """Free a place, once the session's thread has ended."""
        kept = None
        try:
            kept = await connection.close()
        finally:
            self.pool.remove(connection.key, kept)
            connection.seat.leave(connection)
            connection.left.set()

    async def _reclaim(self, key: str) -> Kept | None:
        """Return the session of a key; where another socket still has it, that is hung up on first."""
        holder = self.pool.connections.get(key)
        if holder is not None:
            holder.end(Verdict(TAKEN_OVER, "the session goes on in another page"))
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(holder.left.wait(), _HANDOVER_S)
        return self.pool.reclaim(key)


def upgrade_required() -> Any:
    """Return the answer to a plain request where a WebSocket would open."""
    from starlette.responses import PlainTextResponse

    return PlainTextResponse("open a WebSocket here", 426, {"upgrade": "websocket"})


def _listen(host: str, port: int) -> socket.socket:
    if not 0 <= port < 65536:
        raise ValueError(f"--port = {port} is out of range; give 0 to 65535")
    try:
        return socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        reason = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be listened on ({error.strerror})"
        raise ValueError(f"--port = {port} on {host} {reason}; give another one, or 0 for any free one") from None

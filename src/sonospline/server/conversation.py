"""One WebSocket, from its opening to its end."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable
from typing import Any

from .outbox import Outbox
from .speaker import GOING_AWAY, POLICY, Speaker, Verdict

logger = logging.getLogger(__name__)

UNREAD_S = 15.0
"""How long one message may take to be read."""
_GOODBYE_S = 2.0
_IDLE_CHECK_S = 1.0
_SOCKET_CHECK_S = 0.5


async def converse(
    websocket: Any, connection: Speaker, outbox: Outbox, transport: asyncio.Transport | None, *, idle_s: float
) -> None:
    """Take, send and watch, until one of them ends or the client is to be hung up on."""
    work = [_take(websocket, connection), _send(websocket, outbox), _watch_idleness(connection, idle_s)]
    if transport is not None:
        work.append(_watch_socket(transport))
    tasks: list[asyncio.Future[Any]] = [asyncio.create_task(part) for part in work]
    try:
        await asyncio.wait([*tasks, connection.verdict], return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ends = await asyncio.gather(*tasks, return_exceptions=True)
    for end in ends:
        _note(end)
    if connection.verdict.done():
        verdict = connection.verdict.result()
        refusals = outbox.texts() if verdict.code == POLICY else []  # those that led to it
        await hang_up(websocket, verdict, refusals)


def _note(end: BaseException | None) -> None:
    """Log how a part of a conversation ended."""
    from starlette.websockets import WebSocketDisconnect

    if isinstance(end, WebSocketDisconnect | RuntimeError | OSError):  # a TimeoutError is an OSError
        logger.debug("a client left: %r", end)
    elif isinstance(end, Exception):
        logger.error("a conversation failed", exc_info=end)


async def _take(websocket: Any, connection: Speaker) -> None:
    while True:
        event = await websocket.receive()
        if event["type"] == "websocket.disconnect":
            return
        connection.take(event.get("text"))
        await asyncio.sleep(0)  # messages may wait in a row: let answers leave, and others have their turn


async def _send(websocket: Any, outbox: Outbox) -> None:
    while True:
        message = await outbox.get()
        async with asyncio.timeout(UNREAD_S):
            await _send_one(websocket, message)


async def _send_one(websocket: Any, message: str | bytes) -> None:
    if isinstance(message, str):
        await websocket.send_text(message)
    else:
        await websocket.send_bytes(message)


async def _watch_idleness(connection: Speaker, idle_s: float) -> None:
    while connection.idle_s() < idle_s:
        await asyncio.sleep(min(_IDLE_CHECK_S, idle_s))
    connection.end(Verdict(GOING_AWAY, "idle"))


async def _watch_socket(transport: asyncio.Transport) -> None:
    """End when the socket does: where something was left unread, nobody is told of that."""
    while not transport.is_closing():
        await asyncio.sleep(_SOCKET_CHECK_S)


async def hang_up(websocket: Any, verdict: Verdict, texts: Iterable[str] = ()) -> None:
    """Say why, to a client that still listens."""
    from starlette.websockets import WebSocketDisconnect

    try:
        async with asyncio.timeout(_GOODBYE_S):
            for text in texts:
                await websocket.send_text(text)
            await websocket.close(verdict.code, verdict.reason)
    except (WebSocketDisconnect, RuntimeError, OSError) as error:  # a TimeoutError is an OSError
        logger.debug("a client left before it was hung up on: %r", error)

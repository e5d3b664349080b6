"""The web server's protocols, with limits on connections and on what one socket may pile up."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from .access import RAW_HEADERS
from .connection_limits import ConnectionLimits

MOST_UNREAD = 32 * 1024 * 1024
"""Bytes written that a client has not read: pongs and answers to it come on top of its messages."""
MOST_PARTS = 1024
"""Pieces of one message."""


class _MalformedRequests(logging.Filter):
    """Leaves out what uvicorn says, with a traceback even, of bytes that are no HTTP or no text: anybody sends such."""

    def filter(self, record: logging.LogRecord) -> bool:
        return not record.msg.startswith(("Invalid ", "Unsupported upgrade", "No supported WebSocket"))


_malformed_requests = _MalformedRequests()


def http_protocol(limits: ConnectionLimits) -> type[asyncio.Protocol]:
    """Return uvicorn's protocol for HTTP within limits."""
    import h11
    from uvicorn.protocols.http.h11_impl import H11Protocol

    logging.getLogger("uvicorn.error").addFilter(_malformed_requests)

    class LimitedHttp(H11Protocol):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            limits.opened(transport)

        def connection_lost(self, exc: Exception | None) -> None:
            limits.closed(self.transport)
            super().connection_lost(exc)

        def send_400_response(self, msg: str) -> None:
            if self.cycle is not None:
                self.cycle.disconnected = True  # what is being answered is not waited for any more
            if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
                headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close"), *RAW_HEADERS]
                for event in (
                    h11.Response(status_code=400, headers=headers, reason=b"Bad Request"),
                    h11.Data(data=msg.encode("ascii")),
                    h11.EndOfMessage(),
                ):
                    self.transport.write(self.conn.send(event))
            self.transport.close()

    return LimitedHttp


def websocket_protocol(limits: ConnectionLimits) -> type[asyncio.Protocol]:
    """Return uvicorn's protocol for WebSockets, which ends what piles up."""
    from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

    class BoundedWebSocket(WebSocketsSansIOProtocol):
        def connection_lost(self, exc: Exception | None) -> None:
            limits.closed(self.transport)
            super().connection_lost(exc)

        async def send(self, message: Any) -> None:
            await super().send(message)
            self.handshake_complete |= self.close_sent  # by a refusal, too; else that is logged as a fault

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.transport.get_write_buffer_size() > MOST_UNREAD or len(self.frames) > MOST_PARTS:
                self.transport.abort()

    return BoundedWebSocket

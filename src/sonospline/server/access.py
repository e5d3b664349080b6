"""What every request passes before anything else sees it, and what every answer carries."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any
from urllib.parse import parse_qs

from .guard import Guard

HEADERS = {
    "content-security-policy": (
        "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",  # the token is in the page's address
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
"""No other site may frame the page, take its files or learn its address."""
RAW_HEADERS = [(name.encode(), value.encode()) for name, value in HEADERS.items()]

_MISDIRECTED, _FORBIDDEN = 421, 403


class AccessMiddleware:
    """Turns away requests under a foreign name (421) and WebSockets that the guard refuses (403, never opened).

    Parameters
    ----------
    app : ASGI application
        What serves the requests that pass.
    guard : Guard
        The rules.
    requested : callable
        Called with the address of everybody who asked for something.
    """

    def __init__(self, app: Any, guard: Guard, requested: Callable[[Any], None]) -> None:
        self._app, self._guard, self._requested = app, guard, requested

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Serve one request."""
        if scope["type"] not in ("http", "websocket"):
            return await self._app(scope, receive, send)
        self._requested(scope.get("client"))

        async def send_guarded(message: Any) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                message = {**message, "headers": [*message.get("headers", ()), *RAW_HEADERS]}
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            return await self._app(scope, receive, send_guarded)
        from starlette.responses import PlainTextResponse

        status = _FORBIDDEN if scope["type"] == "websocket" else _MISDIRECTED
        return await PlainTextResponse(refusal + "\n", status)(scope, receive, send_guarded)

    def _refusal(self, scope: Any) -> str | None:
        headers = one_of_each(scope["headers"])
        if scope["type"] == "http":
            return self._guard.foreign_host(headers)
        return self._guard.refusal(headers, token_of(scope))


def one_of_each(raw: Iterable[tuple[bytes, bytes]]) -> dict[str, str]:
    """Return headers by name; those that came twice are joined, so that neither is taken for the only one."""
    headers: dict[str, str] = {}
    for key, value in raw:
        name, text = key.decode("latin-1").lower(), value.decode("latin-1")
        headers[name] = f"{headers[name]}, {text}" if name in headers else text
    return headers


def token_of(scope: Any) -> str | None:
    """Return the token of a request's address, None where there is none or more than one."""
    given = parse_qs(scope["query_string"].decode("latin-1"), keep_blank_values=True, max_num_fields=None).get("token")
    return given[0] if given is not None and len(given) == 1 else None

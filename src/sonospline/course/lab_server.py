"""The web server of a lab: a page for each station, and one for the trainer."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ..lab.database import LabDatabaseError
from ..lab.result_tables import write_csv
from ..server.access import token_of
from ..server.connection_limits import peer_of
from ..server.conversation import converse
from ..server.outbox import Outbox
from ..server.seat import Seat
from ..server.server import Server, upgrade_required
from .door import LOCKED, WRONG, Door
from .trainer_connection import TrainerConnection

if TYPE_CHECKING:
    from .course import Course

_FORBIDDEN, _AWAY = 403, 503


class LabServer(Server):
    """A server whose sessions are stations, with a trainer who sees and sets them.

    Parameters
    ----------
    course : Course
        The stations and their results.
    door : Door, optional
        Who may be the trainer.
    **options
        Of :class:`~sonospline.server.server.Server`.
    """

    def __init__(self, course: Course, *, door: Door | None = None, **options: Any) -> None:
        self.course = course
        self.door = Door() if door is None else door
        super().__init__(course.catalog, sessions=len(course.stations), **options)

    @property
    def trainer_address(self) -> str:
        """Where the trainer's page is; both tokens are in it."""
        page, _, query = self.address.partition("?")
        token = quote(self.door.token, safe="")
        return f"{page}trainer.html?{query + '&' if query else ''}trainer={token}"

    def seat(self, asked: str, key: str) -> Seat | str:
        """Return the station for a page."""
        return self.course.place(asked, key)

    def more_routes(self) -> list[Any]:
        """Return what is the trainer's, and a short address for each station."""
        from starlette.responses import PlainTextResponse, RedirectResponse
        from starlette.routing import Route, WebSocketRoute

        async def station(request: Any) -> Any:
            query = request.url.query
            name = quote(request.path_params["name"], safe="")
            return RedirectResponse(f"/?station={name}{'&' + query if query else ''}", 307)

        async def why_not(request: Any) -> Any:
            refusal = self.guard.refusal(request.headers, token_of(request.scope))
            if refusal is None and not self.door.knows(_token(request)):  # the socket has counted the guess
                refusal = LOCKED if self.door.locked(_address(request)) else WRONG
            return upgrade_required() if refusal is None else PlainTextResponse(refusal, _FORBIDDEN)

        async def table(request: Any) -> Any:
            refusal = self.guard.refusal(request.headers, token_of(request.scope)) or self._refusal(request)
            if refusal is not None:
                return PlainTextResponse(refusal, _FORBIDDEN)
            return await _table(self.course)

        return [
            WebSocketRoute("/trainer", self._trainer), Route("/trainer", why_not),
            Route("/station/{name}", station), Route("/attempts.csv", table),
        ]  # fmt: skip

    async def _trainer(self, websocket: Any) -> None:
        """Serve the trainer's page, where its token is right."""
        if self._refusal(websocket) is not None:
            await websocket.close()
            return
        await websocket.accept()
        transport = self.limits.upgraded(websocket.scope["client"])
        outbox = Outbox()
        trainer = TrainerConnection(self.course, outbox)
        try:
            trainer.open()
            await converse(websocket, trainer, outbox, transport, idle_s=1.0)
        finally:
            if transport is not None:
                self.limits.closing(transport)
            await trainer.close()

    def _refusal(self, asked: Any) -> str | None:
        return self.door.refusal(_token(asked), _address(asked))


def _token(asked: Any) -> str:
    token: str = asked.query_params.get("trainer", "")
    return token


def _address(asked: Any) -> str:
    return peer_of(asked.scope["client"])


async def _table(course: Course) -> Any:
    """Every attempt as CSV, or why that cannot be."""
    import asyncio

    from starlette.responses import PlainTextResponse, Response

    def written() -> str:
        stream = io.StringIO(newline="")
        write_csv(course.store.attempts(), stream)
        return stream.getvalue()

    try:
        text = await asyncio.to_thread(written)
    except LabDatabaseError as error:
        return PlainTextResponse(str(error), _AWAY)
    return Response(text, media_type="text/csv", headers={"content-disposition": 'attachment; filename="attempts.csv"'})

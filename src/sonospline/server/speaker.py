"""Whoever answers on a WebSocket: hears messages, refuses what is none, and says when the client is hung up on."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any, NamedTuple

from .client_messages import MessageError, parse
from .outbox import Outbox
from .rate_limits import MOST_REFUSALS, REFUSALS_S, RateLimits
from .sender import Sender
from .server_messages import Refused

POLICY, GOING_AWAY, TAKEN_OVER = 1008, 1001, 4001


class Verdict(NamedTuple):
    """Why a client is hung up on: the closing code, and the reason it is given."""

    code: int
    reason: str


class Speaker:
    """One end of a conversation; what is done with a message is up to its kinds.

    Parameters
    ----------
    kinds : mapping of str to type
        Messages that are understood, by their types.
    outbox : Outbox
        Where messages to the client go, in order.
    """

    def __init__(self, kinds: Mapping[str, type[Any]], outbox: Outbox) -> None:
        self._kinds = kinds
        self.sender = Sender(outbox, lambda: self.end(Verdict(POLICY, "messages are not read")))
        self._limits = RateLimits()
        self.verdict: asyncio.Future[Verdict] = asyncio.get_running_loop().create_future()
        """Set when the client is to be hung up on."""

    def end(self, verdict: Verdict) -> None:
        """Have the client hung up on."""
        if not self.verdict.done():
            self.verdict.set_result(verdict)

    def idle_s(self) -> float:
        """Return how long ago the client last asked for something; 0 lets it look on for as long as it likes."""
        return 0.0

    def take(self, text: str | None) -> None:
        """Do what a message says, or refuse it."""
        try:
            self._limits.count_message()
            if text is None:
                raise MessageError("message", "is binary; send JSON text")
            self._heed(parse(self._kinds, text))
        except MessageError as error:
            self._refuse(error.what, str(error), seq=error.seq)

    def _heed(self, message: Any) -> None:
        """Do what a message says, or raise MessageError."""
        raise NotImplementedError

    def _refuse(
        self, what: str, problem: str, *, seq: int | None = None, file: str | None = None, line: int | None = None
    ) -> None:
        self.sender.say(Refused(what=what, message=problem, file=file, line=line, seq=seq))
        if self._limits.count_refusal():
            self.end(Verdict(POLICY, f"{MOST_REFUSALS} refusals within {REFUSALS_S:g} s"))

"""One page on one WebSocket: what it says, heeded or refused."""

from __future__ import annotations

import asyncio
import time
from operator import methodcaller
from typing import TYPE_CHECKING, NamedTuple

from .. import models
from ..io.records import FieldError
from . import client_messages as heard
from . import server_messages as said
from .client_messages import MessageError
from .flow import FrameFlow
from .kept_session import Kept
from .live_session import LiveSession, Watch
from .outbox import Outbox
from .rate_limits import MOST_REFUSALS, REFUSALS_S, RateLimits
from .scene_catalog import SceneCatalog
from .scene_loader import SceneLoader
from .sender import Sender

if TYPE_CHECKING:
    from ..simulator.console import Console

POLICY, GOING_AWAY, TAKEN_OVER = 1008, 1001, 4001


class Verdict(NamedTuple):
    """Why a client is hung up on: the closing code, and the reason it is given."""

    code: int
    reason: str


class Connection:
    """What stands between a socket and a session.

    The socket's own loop calls :meth:`open`, :meth:`take` and :meth:`close`.

    Parameters
    ----------
    catalog : SceneCatalog
        Scenes.
    outbox : Outbox
        Where messages to the client go, in order.
    key : str, default: ""
        What the session can be asked back by.
    watch : callable, optional
        Called with the runner of each of its sessions.
    """

    def __init__(self, catalog: SceneCatalog, outbox: Outbox, key: str = "", *, watch: Watch | None = None) -> None:
        self._catalog, self.key, self._watch = catalog, key, watch
        self._sender = Sender(outbox, lambda: self.end(Verdict(POLICY, "messages are not read")))
        self._loader = SceneLoader(catalog, self._sender, self._refuse, self._replace)
        self._live: LiveSession | None = None
        self._flow, self._limits = FrameFlow(), RateLimits()
        self._seq = -1
        self._busy_at = time.monotonic()
        self.verdict: asyncio.Future[Verdict] = asyncio.get_running_loop().create_future()
        """Set when the client is to be hung up on."""
        self.left = asyncio.Event()
        """Set by the server once the place is free."""

    def open(self, kept: Kept | None = None) -> None:
        """Greet the client; go on with a session that was kept for it, or load the first scene."""
        self._sender.say(self._catalog.hello(self.key, resumed=kept is not None))
        if kept is None:
            self._loader.load(self._catalog.first)
        else:
            self._start(kept.scene, kept.console)

    async def close(self) -> Kept | None:
        """End the session's thread; return the session where it is worth to be kept."""
        await self._loader.close()
        live = await self._end()
        over = self.verdict.done() and self.verdict.result().code != TAKEN_OVER
        if live is None or over:
            self._catalog.release_memory()
            return None
        live.console.pause()
        return Kept(live.name, live.console)

    def end(self, verdict: Verdict) -> None:
        """Have the client hung up on."""
        if not self.verdict.done():
            self.verdict.set_result(verdict)

    def idle_s(self) -> float:
        """Return how long ago the client last asked for something; 0 while a scene is loading."""
        return 0.0 if self._loader.busy else time.monotonic() - self._busy_at

    def take(self, text: str | None) -> None:
        """Do what a message says, or refuse it."""
        try:
            self._limits.count_message()
            if text is None:
                raise MessageError("message", "is binary; send JSON text")
            message = heard.parse(text)
            if not isinstance(message, heard.Drawn | heard.Ping):
                self._busy_at = time.monotonic()
            self._do(message)
        except MessageError as error:
            self._refuse(error.what, str(error), seq=error.seq)

    def _do(self, message: heard.Message) -> None:
        match message:
            case heard.Drawn():
                self._flow.drawn(message.frame)
                if self._live is not None:
                    self._live.wake()
            case heard.Ping():
                self._sender.say(said.Pong())
            case heard.CommandMessage():
                self._obey(message)
            case heard.View():
                self._flow.view(message.grid, message.ahead)
                self._ready("message").look_again()
            case heard.ChooseModel():
                self._switch(message.model)
            case heard.ChooseTarget():
                self._aim(message.id)
            case heard.UndoPass():
                self._ready("message").act(methodcaller("undo_pass"))
            case heard.Reset():
                self._ready("message").act(methodcaller("reset"))
            case heard.Restore():
                self._ready("message").act(methodcaller("restore"))
            case heard.ChooseScene():
                if message.id not in self._catalog.scenes:
                    known = ", ".join(self._catalog.scenes)
                    raise MessageError("scene", f"id = {message.id[:40]!r} is not known; choose one of {known}")
                self._loader.load(message.id)
            case heard.OpenScene():
                self._loader.load(message.name, message.text)

    def _obey(self, message: heard.CommandMessage) -> None:
        seq = message.seq
        if seq <= self._seq:
            raise MessageError("command", f"seq = {seq} is out of order; give more than {self._seq}", seq)
        live = self._ready("command", seq)
        try:
            live.submit(message.command, seq)
        except FieldError as error:
            raise MessageError("command", str(error), seq) from None
        self._seq = seq

    def _switch(self, model: str) -> None:
        known = models.names()
        if model not in known:
            raise MessageError("model", f"model = {model[:40]!r} is not known; choose one of {', '.join(known)}")
        self._ready("message").act(lambda console: console.session.switch(model))
        self._sender.say(said.ModelMessage(model=model))

    def _aim(self, target: str) -> None:
        live = self._ready("target")
        targets = live.console.scene.targets
        if target not in targets:
            raise MessageError("target", f"id = {target[:40]!r} is not known; choose one of {', '.join(targets)}")
        live.act(lambda console: console.session.choose_target(target))
        self._sender.say(said.TargetMessage(id=target))

    def _ready(self, what: str, seq: int | None = None) -> LiveSession:
        if self._live is None or self._live.ended:
            raise MessageError(what, "came while the scene is loading; wait for the scene message", seq)
        return self._live

    async def _replace(self, name: str, console: Console) -> None:
        """Let a new scene take the place of the present one."""
        await self._end()
        self._catalog.release_memory()
        self._start(name, console)

    def _start(self, name: str, console: Console) -> None:
        self._busy_at = time.monotonic()
        self._live = LiveSession(name, console, self._flow, self._sender, self._catalog, self._watch)

    async def _end(self) -> LiveSession | None:
        live = self._live
        if live is not None:
            await live.end()  # whoever closes the connection meanwhile waits for the same thread
            self._live = None
        return live

    def _refuse(
        self, what: str, problem: str, *, seq: int | None = None, file: str | None = None, line: int | None = None
    ) -> None:
        self._sender.say(said.Refused(what=what, message=problem, file=file, line=line, seq=seq))
        if self._limits.count_refusal():
            self.end(Verdict(POLICY, f"{MOST_REFUSALS} refusals within {REFUSALS_S:g} s"))

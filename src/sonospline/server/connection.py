"""One page on one WebSocket: what it says, heeded or refused."""

from __future__ import annotations

import asyncio
import time
from operator import methodcaller
from typing import TYPE_CHECKING, cast

from .. import models
from . import client_messages as heard
from . import server_messages as said
from .client_messages import MessageError
from .flow import FrameFlow
from .kept_session import Kept
from .live_session import LiveSession, Watch
from .outbox import Outbox
from .review import Review
from .scene_catalog import SceneCatalog
from .scene_loader import SceneLoader
from .seat import Seat
from .speaker import TAKEN_OVER, Speaker

if TYPE_CHECKING:
    from .live_attempt import LiveAttempt
    from .stage import Stage


class Connection(Speaker):
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
    seat : Seat, optional
        Who sits there.
    """

    def __init__(
        self, catalog: SceneCatalog, outbox: Outbox, key: str = "", *, watch: Watch | None = None,
        seat: Seat | None = None,
    ) -> None:  # fmt: skip
        super().__init__(heard.KINDS, outbox)
        self._catalog, self.key, self._watch = catalog, key, watch
        self.seat = Seat() if seat is None else seat
        self._loader = SceneLoader(catalog, self.sender, self._refuse, self._replace)
        self._live: LiveSession | None = None
        self._review: Review | None = None
        self._flow = FrameFlow(self.seat)
        self._seq = -1
        self._changes = asyncio.Lock()
        self._closed = False
        self._busy_at = time.monotonic()
        self.left = asyncio.Event()
        """Set by the server once the place is free."""

    def open(self, kept: Kept | None = None) -> None:
        """Greet the client; go on with a session that was kept for it, or load the first scene."""
        self.sender.say(self._catalog.hello(self.key, resumed=kept is not None))
        self.seat.take(self)
        if kept is None:
            self._loader.load(self._catalog.first)
        else:
            self._start(kept.scene, kept.stage)

    async def close(self) -> Kept | None:
        """End the session's thread; return the session where it is worth to be kept."""
        self._closed = True
        await self._loader.close()
        live, review = await self._end(), self._review
        if review is not None:
            await review.end()
        over = self.verdict.done() and self.verdict.result().code != TAKEN_OVER
        if live is None or over:
            if live is not None:
                live.stage.close()
            self._catalog.release_memory()
            return None
        live.stage.pause()
        return Kept(live.name, live.stage)

    def idle_s(self) -> float:
        """Return how long ago the client last asked for something; 0 while a scene is loading."""
        return 0.0 if self._loader.busy else time.monotonic() - self._busy_at

    def _heed(self, message: heard.Message) -> None:
        if not isinstance(message, heard.Drawn | heard.Ping):
            self._busy_at = time.monotonic()
        refusal = self.seat.refusal(message)
        if refusal is not None:
            raise MessageError(str(message.__struct_config__.tag), refusal)
        self._do(message)

    def _do(self, message: heard.Message) -> None:
        match message:
            case heard.Drawn():
                self._flow.drawn(message.frame)
                if self._live is not None:
                    self._live.wake()
            case heard.Ping():
                self.sender.say(said.Pong())
            case heard.CommandMessage():
                self._obey(message)
            case heard.View():
                self._flow.view(message.grid, message.ahead)
                if self._review is None:  # a replay is looked at as it comes
                    self._ready("message").look_again()
            case heard.ChooseModel():
                self._switch(message.model)
            case heard.ChooseTarget():
                self._aim(message.id)
            case heard.UndoPass():
                self._practice("undo_pass").act(lambda stage: stage.console.undo_pass())
            case heard.Reset():
                self._practice("reset").act(lambda stage: stage.console.reset())
            case heard.Restore():
                self._practice("restore").act(lambda stage: stage.console.restore())
            case heard.ListExercises():
                self.sender.say(self._catalog.exercises.offer)
            case heard.BeginAttempt():
                self._begin(message.exercise, message.seed)
            case heard.OnTarget():
                self._attempt("on_target").act(methodcaller("say_on_target"))
            case heard.GiveUp():
                self._attempt("give_up").act(methodcaller("give_up"))
            case heard.ShowStep():
                if self._review is None:
                    raise MessageError("show_step", "came while nothing is replayed; end an attempt first")
                self._review.show(message.step)
            case heard.AddComment():
                if self._review is None:
                    raise MessageError("add_comment", "came while no attempt is talked about; end one first")
                self._review.comment(message.time_s, message.text)
            case heard.SitDown():
                self.seat.sit_down(message.participant)
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
            live.submit(self.seat.heeded(message.command), seq)
        except ValueError as error:
            raise MessageError("command", str(error), seq) from None
        self._seq = seq

    def _begin(self, exercise: str, seed: int | None) -> None:
        known = self._catalog.exercises.entries
        if exercise not in known:
            names = ", ".join(known)
            raise MessageError("begin_attempt", f"exercise = {exercise[:40]!r} is not known; choose one of {names}")
        self._loader.attempt(exercise, seed)

    def _switch(self, model: str) -> None:
        known = models.names()
        if model not in known:
            raise MessageError("model", f"model = {model[:40]!r} is not known; choose one of {', '.join(known)}")
        self._practice("model").act(lambda stage: stage.console.session.switch(model))
        self.sender.say(said.ModelMessage(model=model))

    def _aim(self, target: str) -> None:
        live = self._practice("target")
        targets = live.console.scene.targets
        if target not in targets:
            raise MessageError("target", f"id = {target[:40]!r} is not known; choose one of {', '.join(targets)}")
        live.act(lambda stage: stage.console.session.choose_target(target))
        self.sender.say(said.TargetMessage(id=target))

    def _ready(self, what: str, seq: int | None = None) -> LiveSession:
        if self._live is None or self._live.ended:
            raise MessageError(what, f"came while {self._why_not_live()}", seq)
        return self._live

    def _why_not_live(self) -> str:
        if self._review is not None:
            return "an attempt is talked about; begin another one, or choose a scene"
        return "the scene is loading; wait for the scene message"

    def _practice(self, what: str) -> LiveSession:
        """The session, where nothing is asked of the hand."""
        live = self._ready(what)
        if live.stage.exercise is not None:
            raise MessageError(what, "is not part of an exercise; give up first")
        return live

    def _attempt(self, what: str) -> LiveSession:
        """The session of an attempt."""
        live = self._ready(what)
        if live.stage.exercise is None:
            raise MessageError(what, "came while no exercise runs; begin one")
        return live

    def freeze(self, on: bool) -> None:
        """Have time stand still, or go on, where something is worked on."""
        if self._live is not None and not self._live.ended:
            self._live.freeze(on)

    async def begin_again(self) -> None:
        """Let a page go on with what it works on as if it had just come: what may be shown has changed."""
        async with self._changes:
            live = None if self._review is not None else await self._end()
            if live is not None and not self._closed:
                self._start(live.name, live.stage)

    async def _replace(self, name: str, stage: Stage) -> None:
        """Let something new take the place of what a page worked on."""
        async with self._changes:
            live = await self._end()
            if live is not None:
                live.stage.close()
            if self._review is not None:
                await self._review.end()
                self._review = None
            self._catalog.release_memory()
            self._start(name, stage)

    def _start(self, name: str, stage: Stage) -> None:
        self._busy_at = time.monotonic()
        self.seat.began(name, stage)
        if stage.exercise is None:
            self.sender.say(said.SceneMessage.of(name, stage.console, stage.command, stage.start, stage.guides))
            self._live = LiveSession(name, stage, self._flow, self.sender, self._catalog, self._watch)
            return
        attempt = cast("LiveAttempt", stage)
        offered = next(one for one in self._catalog.exercises.offer.offered if one.id == attempt.exercise)
        running = said.RunningAttempt(exercise=offered, seed=attempt.attempt.seed, recorded=attempt.recording.problem)
        self.sender.say(said.SceneMessage.of(name, stage.console, stage.command, stage.start, stage.guides, running))
        self._live = live = LiveSession(name, stage, self._flow, self.sender, self._catalog)
        attempt.recording.on_problem = self.sender.report
        attempt.on_end = lambda: self.sender.call(self._talk_about, live)
        if attempt.over:
            self._talk_about(live)

    def _talk_about(self, live: LiveSession) -> None:
        """An attempt has come to its end."""
        if live is self._live and self._review is None:
            self._review = Review(live, cast("LiveAttempt", live.stage), self._catalog, self._flow, self.sender)

    async def _end(self) -> LiveSession | None:
        live = self._live
        if live is not None:
            await live.end()  # whoever closes the connection meanwhile waits for the same thread
            self._live = None
        return live

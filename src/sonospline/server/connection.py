"""One browser on one WebSocket: what it says, and what it is told."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from functools import partial
from operator import methodcaller
from typing import TYPE_CHECKING, Any, NamedTuple

from ..simulator.runner import Runner, Stamp
from ..simulator.scene_file import MODELS, SceneError
from . import client_messages, wire
from . import server_messages as said
from .client_messages import MessageError
from .flow import FrameFlow
from .outbox import Outbox
from .rate_limits import MOST_REFUSALS, REFUSALS_S, RateLimits
from .scene_catalog import SceneCatalog
from .session_pool import Kept

if TYPE_CHECKING:
    from ..simulator.session import Session
    from ..simulator.shot import Shot
    from ..simulator.subscription import Subscription

logger = logging.getLogger(__name__)

_POLL_S = 0.005
MOST_ACTIONS = 240
"""Actions that may wait for a page that draws no frames."""
POLICY, GOING_AWAY, TAKEN_OVER = 1008, 1001, 4001


class Verdict(NamedTuple):
    """Why a client is hung up on: the closing code, and what it is told."""

    code: int
    reason: str


class Connection:
    """What stands between a socket and a session.

    The socket's own loop calls :meth:`open`, :meth:`take` and :meth:`close`; frames are made and encoded in the
    session's thread and handed to the outbox.

    Parameters
    ----------
    catalog : SceneCatalog
        Scenes.
    outbox : Outbox
        Where messages to the client go, in order.
    key : str, default: ""
        What the session can be asked back by.
    """

    def __init__(self, catalog: SceneCatalog, outbox: Outbox, key: str = "") -> None:
        self._catalog, self._outbox, self.key = catalog, outbox, key
        self._loop = asyncio.get_running_loop()
        self._runner: Runner | None = None
        self._frames: Subscription | None = None
        self._session: Session | None = None
        self._scene = ""
        self._loading: asyncio.Task[None] | None = None
        self._showing: asyncio.Task[None] | None = None
        self._seq, self._closed = -1, False
        self._flow, self._limits = FrameFlow(), RateLimits()
        self._busy_at = time.monotonic()
        self.verdict: asyncio.Future[Verdict] = self._loop.create_future()
        """Set when the client is to be hung up on."""
        self.left = asyncio.Event()
        """Set by the server once the place is free."""

    def open(self, kept: Kept | None = None) -> None:
        """Greet the client; go on with a session that was kept for it, or load the first scene."""
        self._tell(self._catalog.hello(self.key, resumed=kept is not None))
        if kept is None:
            self._load(self._catalog.first)
        else:
            self._start(kept.scene, kept.session)

    async def close(self) -> Kept | None:
        """End the session's thread; return the session where it is worth to be kept."""
        self._closed = True
        for task in (self._loading, self._showing):
            if task is not None:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
        session = self._session
        await self._end()
        over = self.verdict.done() and self.verdict.result().code != TAKEN_OVER
        if session is None or over:
            self._catalog.release_memory()
            return None
        session.pause()
        return Kept(self._scene, session)

    def end(self, verdict: Verdict) -> None:
        """Have the client hung up on."""
        if not self.verdict.done():
            self.verdict.set_result(verdict)

    def idle_s(self) -> float:
        """Return how long ago the client last asked for something; 0 while a scene is loading."""
        loading = self._loading is not None and not self._loading.done()
        return 0.0 if loading else time.monotonic() - self._busy_at

    def take(self, text: str | None) -> None:
        """Do what a message says, or refuse it."""
        try:
            self._limits.count_message()
            if text is None:
                raise MessageError("message", "is binary; send JSON text")
            message = client_messages.parse(text)
            if not isinstance(message, client_messages.Drawn | client_messages.Ping):
                self._busy_at = time.monotonic()
            self._do(message)
        except MessageError as error:
            self._refuse(error.what, str(error), seq=error.seq)

    def _do(self, message: client_messages.Message) -> None:
        match message:
            case client_messages.Drawn():
                self._flow.drawn(message.frame)
                if self._frames is not None:
                    self._frames.wake()
            case client_messages.Ping():
                self._tell(said.Pong())
            case client_messages.CommandMessage():
                self._obey(message)
            case client_messages.View():
                self._flow.view(message.grid, message.ahead)
                self._act(_look_again)
            case client_messages.ChooseModel():
                self._switch(message.model)
            case client_messages.ChooseTarget():
                self._aim(message.id)
            case client_messages.UndoPass():
                self._act(methodcaller("undo_pass"))
            case client_messages.Reset():
                self._act(methodcaller("reset"))
            case client_messages.Restore():
                self._act(methodcaller("restore"))
            case client_messages.ChooseScene():
                if message.id not in self._catalog.scenes:
                    known = ", ".join(self._catalog.scenes)
                    raise MessageError("scene", f"id = {message.id[:40]!r} is not known; choose one of {known}")
                self._load(message.id)
            case client_messages.OpenScene():
                self._load(message.name, message.text)

    def _obey(self, message: client_messages.CommandMessage) -> None:
        if message.seq <= self._seq:
            raise MessageError(
                "command", f"seq = {message.seq} is out of order; give more than {self._seq}", message.seq
            )
        session, runner = self._ready("command", message.seq)
        try:
            session.scene.knobs.check(message.command)
        except ValueError as error:
            raise MessageError("command", str(error), message.seq) from None
        self._seq = message.seq
        runner.submit(message.command, message.seq)

    def _switch(self, model: str) -> None:
        if model not in MODELS:
            raise MessageError("model", f"model = {model[:40]!r} is not known; choose one of {', '.join(MODELS)}")
        self._act(lambda session: session.switch(model))
        self._tell(said.ModelMessage(model=model))

    def _aim(self, target: str) -> None:
        session, _ = self._ready("target")
        targets = session.scene.targets
        if target not in targets:
            raise MessageError("target", f"id = {target[:40]!r} is not known; choose one of {', '.join(targets)}")
        self._act(lambda session: session.choose_target(target))
        self._tell(said.TargetMessage(id=target))

    def _act(self, action: Callable[[Session], None]) -> None:
        _, runner = self._ready("message")
        if runner.waiting >= MOST_ACTIONS:
            raise MessageError("message", f"comes after {MOST_ACTIONS} that wait; say which frames were drawn")
        runner.do(action)

    def _ready(self, what: str, seq: int | None = None) -> tuple[Session, Runner]:
        if self._session is None or self._runner is None:
            raise MessageError(what, "came while the scene is loading; wait for the scene message", seq)
        return self._session, self._runner

    def _load(self, name: str, text: str | None = None) -> None:
        if self._loading is not None and not self._loading.done():
            raise MessageError("scene", "came while another one is loading; wait for it")
        self._tell(said.Loading(scene=name, name=self._catalog.title(name), share=0.0))
        self._loading = self._loop.create_task(self._bring(name, text))

    async def _bring(self, name: str, text: str | None) -> None:
        """Make a session of a scene and let it take the place of the present one; where that fails, that stays."""

        def progress(share: float) -> None:
            self._from_thread(said.Loading(scene=name, name=self._catalog.title(name), share=share))

        file = name if text is not None else None
        try:
            session = await asyncio.wrap_future(self._catalog.order(name, text, progress, lambda: not self._closed))
        except SceneError as error:
            self._refuse("scene", error.problem, file=error.file, line=error.line)
        except (ValueError, OSError, ImportError, MemoryError) as error:
            self._refuse("scene", str(error), file=file)
        except Exception as error:
            logger.exception("scene %s could not be made", name)
            self._refuse("scene", f"could not be made ({error})", file=file)
        else:
            await self._end()
            self._catalog.release_memory()
            self._start(name, session)

    async def _end(self) -> None:
        runner, self._runner, self._frames, self._session = self._runner, None, None, None
        if runner is not None:
            runner.stop()
            while runner.alive:  # it is in the middle of a step
                await asyncio.sleep(_POLL_S)

    def _start(self, name: str, session: Session) -> None:
        self._scene, self._session, self._busy_at = name, session, time.monotonic()
        self._flow.begin(session)
        self._tell(said.SceneMessage.of(name, session))
        self._runner = Runner(session)
        self._frames = self._runner.subscribe(
            partial(self._deliver, session), on_error=self._on_error, ready=self._flow.may_send, quick=True
        )

    def _deliver(self, session: Session, shot: Shot, stamp: Stamp) -> None:
        """Encode a frame; in the session's thread."""
        self._call(self._put, self._flow.encode(session.scene, shot, stamp))
        if self._flow.at_first:  # nothing shall keep the first picture waiting
            self._call(self._show, session)

    def _show(self, session: Session) -> None:
        self._showing = self._loop.create_task(self._bring_meshes(session))

    async def _bring_meshes(self, session: Session) -> None:
        scene = session.scene
        try:
            geometry = await asyncio.wrap_future(self._catalog.geometry(session, lambda: self._session is session))
        except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
            logger.warning("the surfaces of a scene could not be made: %s", error)
            self._on_error(f"the 3-D view has no surfaces: {error}")
            return
        if self._session is session and self._runner is not None:
            self._put(geometry)
            self._flow.show(scene)
            self._runner.do(_look_again)  # where nothing moves, the positions come by one more frame

    def _on_error(self, line: str) -> None:
        self._from_thread(said.Notice(level="fault", message=line))

    def _from_thread(self, message: said.ServerMessage) -> None:
        self._call(self._tell, message)

    def _call(self, function: Callable[[Any], None], argument: Any) -> None:
        """Have something done in the socket's loop; nothing where that has ended."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(function, argument)

    def _tell(self, message: said.ServerMessage) -> None:
        self._put(wire.text(message))

    def _put(self, message: str | bytes) -> None:
        if not self._outbox.put(message):
            self.end(Verdict(POLICY, "messages are not read"))

    def _refuse(
        self, what: str, problem: str, *, seq: int | None = None, file: str | None = None, line: int | None = None
    ) -> None:
        self._tell(said.Refused(what=what, message=problem, file=file, line=line, seq=seq))
        if self._limits.count_refusal():
            self.end(Verdict(POLICY, f"{MOST_REFUSALS} refusals within {REFUSALS_S:g} s"))


def _look_again(session: Session) -> None:
    """Ask nothing of a session but another frame."""

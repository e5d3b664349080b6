"""One browser on one WebSocket: its session, its credit, its manners."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from operator import methodcaller
from typing import TYPE_CHECKING, Any

from . import messages, wire
from .library import Library
from .messages import MessageError
from .runner import Runner, Stamp
from .scene_file import MODELS, SceneError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .session import Session
    from .shot import Shot
    from .world import World

logger = logging.getLogger(__name__)

MESH_HZ = 15.0
_POLL_S = 0.005
MOST_MESSAGES_S = 240
MOST_REFUSALS, REFUSALS_S = 20, 10.0
POLICY, GOING_AWAY = 1008, 1001

Send = Callable[[str | bytes], Any]


class MisbehaviourError(Exception):
    """The client is to be hung up on."""

    def __init__(self, code: int, reason: str) -> None:
        self.code, self.reason = code, reason
        super().__init__(reason)


class Connection:
    """What stands between a socket and a session.

    The socket's own loop calls :meth:`open`, :meth:`take` and :meth:`close`; frames are made and encoded in the
    session's thread and handed to ``outbox``.

    Parameters
    ----------
    library : Library
        Scenes.
    outbox : asyncio.Queue
        Where messages to the client go, in order.
    """

    def __init__(self, library: Library, outbox: asyncio.Queue[str | bytes]) -> None:
        self._library, self._outbox = library, outbox
        self._loop = asyncio.get_running_loop()
        self._runner: Runner | None = None
        self._session: Session | None = None
        self._loading: asyncio.Task[None] | None = None
        self._seq = -1
        self._flying: deque[int] = deque()
        self._frames = self._of_older_scenes = 0
        self._grid_wanted, self._ahead = False, 1
        self._sent_field: object = None
        self._sent_grid = False
        self._shown: World | None = None
        self._showing: asyncio.Task[None] | None = None
        self._mesh_at = -1.0
        self._refusals: deque[float] = deque(maxlen=MOST_REFUSALS)
        self._arrivals: deque[float] = deque(maxlen=MOST_MESSAGES_S)
        self._busy_at = time.monotonic()
        self.deaf = False
        """Whether the client left more messages unread than are kept for it."""

    async def open(self) -> None:
        """Greet the client and load the first scene."""
        self._tell(self._library.hello())
        self._load(self._library.first)

    async def close(self) -> None:
        """End the session's thread."""
        for task in (self._loading, self._showing):
            if task is not None:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
        await self._end()

    def idle_s(self) -> float:
        """Return how long ago the client last asked for something; 0 while a scene is loading."""
        loading = self._loading is not None and not self._loading.done()
        return 0.0 if loading else time.monotonic() - self._busy_at

    async def take(self, text: str | None) -> None:
        """Do what a message says, or refuse it.

        Raises
        ------
        MisbehaviourError
            Too many refusals.
        """
        try:
            self._keep_pace()
            if text is None:
                raise MessageError("message", "is binary; send JSON text")
            message = messages.parse(text)
            if not isinstance(message, messages.Drawn | messages.Ping):
                self._busy_at = time.monotonic()
            self._do(message)
        except MessageError as error:
            self._refuse(error.what, str(error), seq=error.seq)

    def _keep_pace(self) -> None:
        now = time.monotonic()
        if len(self._arrivals) == MOST_MESSAGES_S and now - self._arrivals[0] < 1:
            raise MessageError("message", f"came too fast; send at most {MOST_MESSAGES_S} a second")
        self._arrivals.append(now)

    def _do(self, message: messages.Message) -> None:
        match message:
            case messages.Drawn():
                self._drawn(message.frame)
            case messages.Ping():
                self._tell({"type": "pong"})
            case messages.State():
                self._state(message)
            case messages.View():
                self._grid_wanted, self._ahead = message.grid, message.ahead
                self._command(lambda session: None)
            case messages.Model():
                self._switch(message.model)
            case messages.Target():
                self._aim(message.id)
            case messages.UndoPass():
                self._command(methodcaller("undo_pass"))
            case messages.Reset():
                self._command(methodcaller("reset"))
            case messages.Restore():
                self._command(methodcaller("restore"))
            case messages.ChooseScene():
                if message.id not in self._library.scenes:
                    known = ", ".join(self._library.scenes)
                    raise MessageError("scene", f"id = {message.id[:40]!r} is not known; choose one of {known}")
                self._load(message.id)
            case messages.OpenScene():
                self._load(message.name, message.text)

    def _drawn(self, frame: int) -> None:
        if frame <= self._of_older_scenes:
            return
        if frame not in self._flying:
            raise MessageError("drawn", f"frame = {frame} is not in flight; say once that a frame was drawn")
        while self._flying and self._flying[0] <= frame:
            self._flying.popleft()
        if self._runner is not None:
            self._runner.wake()

    def _state(self, message: messages.State) -> None:
        if message.seq <= self._seq:
            raise MessageError("state", f"seq = {message.seq} is out of order; give more than {self._seq}", message.seq)
        session = self._ready_session("state", message.seq)
        try:
            session.world.limits.check(message.wish)
        except ValueError as error:
            raise MessageError("state", str(error), message.seq) from None
        self._seq = message.seq
        assert self._runner is not None
        self._runner.ask(message.wish, message.seq)

    def _switch(self, model: str) -> None:
        if model not in MODELS:
            raise MessageError("model", f"model = {model[:40]!r} is not known; choose one of {', '.join(MODELS)}")
        self._command(lambda session: session.switch(model))
        self._tell({"type": "model", "model": model})

    def _aim(self, target: str) -> None:
        targets = self._ready_session("target").world.targets
        if target not in targets:
            raise MessageError("target", f"id = {target[:40]!r} is not known; choose one of {', '.join(targets)}")
        self._command(lambda session: session.choose_target(target))
        self._tell({"type": "target", "id": target})

    def _command(self, command: Callable[[Session], None]) -> None:
        self._ready_session("message")
        assert self._runner is not None
        self._runner.do(command)

    def _ready_session(self, what: str, seq: int | None = None) -> Session:
        if self._session is None or self._runner is None:
            raise MessageError(what, "came while the scene is loading; wait for the scene message", seq)
        return self._session

    def _load(self, name: str, text: str | None = None) -> None:
        if self._loading is not None and not self._loading.done():
            raise MessageError("scene", "came while another one is loading; wait for it")
        self._tell({"type": "loading", "scene": name, "name": self._library.title(name), "share": 0.0})
        self._loading = self._loop.create_task(self._bring(name, text))

    async def _bring(self, name: str, text: str | None) -> None:
        """Make a session of a scene and let it take the place of the present one; where that fails, that stays."""

        def progress(share: float) -> None:
            self._from_thread({"type": "loading", "scene": name, "name": self._library.title(name), "share": share})

        try:
            session = await asyncio.wrap_future(self._library.order(name, text, progress))
        except SceneError as error:
            self._refuse("scene", error.problem, file=error.file, line=error.line)
        except (ValueError, OSError, ImportError, MemoryError) as error:
            self._refuse("scene", str(error), file=name if text is not None else None)
        except Exception as error:
            logger.exception("scene %s could not be made", name)
            self._refuse("scene", f"could not be made ({error})", file=name if text is not None else None)
        else:
            await self._end()
            self._start(name, session)

    async def _end(self) -> None:
        runner, self._runner, self._session = self._runner, None, None
        if runner is not None:
            runner.stop()
            while runner.alive:  # it is in the middle of a step
                await asyncio.sleep(_POLL_S)
            del runner
            self._library.tidy()

    def _start(self, name: str, session: Session) -> None:
        self._session, self._busy_at = session, time.monotonic()
        self._flying.clear()
        self._of_older_scenes, self._shown = self._frames, None
        self._sent_field = session.rest
        self._tell(wire.scene(name, session))
        self._runner = Runner(
            session, partial(self._deliver, session.world), complain=self._complain, ready=self._may_send
        )

    def _may_send(self) -> bool:
        return len(self._flying) <= self._ahead

    def _deliver(self, world: World, shot: Shot, stamp: Stamp) -> None:
        """Encode a frame; in the session's thread."""
        positions = self._positions(world, shot)
        self._frames += 1
        server_ms = 1e3 * (time.perf_counter() - stamp.since)
        encoded = wire.frame(
            shot, number=self._frames, seq=stamp.seq, positions=positions,
            grid=positions is not None and self._sent_grid, server_ms=server_ms,
        )  # fmt: skip
        self._flying.append(self._frames)
        self._call(self._put, encoded)
        if self._frames == self._of_older_scenes + 1:  # nothing shall keep the first picture waiting
            self._call(self._show, world)

    def _show(self, world: World) -> None:
        self._showing = self._loop.create_task(self._bring_meshes(world))

    async def _bring_meshes(self, world: World) -> None:
        try:
            geometry = await asyncio.wrap_future(self._library.geometry(world))
        except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
            logger.warning("the surfaces of a scene could not be made: %s", error)
            self._complain(f"the 3-D view has no surfaces: {error}")
            return
        if self._session is not None and self._session.world is world:
            self._put(geometry)
            self._shown = world

    def _positions(self, world: World, shot: Shot) -> NDArray[np.float32] | None:
        """Deformed vertices where the tissue moved since they were last sent, and that was long enough ago."""
        if world is not self._shown:
            return None
        now = time.monotonic()
        changed = shot.field is not self._sent_field or self._grid_wanted != self._sent_grid
        if not changed or now - self._mesh_at < 1 / MESH_HZ:
            return None
        self._sent_field, self._mesh_at, self._sent_grid = shot.field, now, self._grid_wanted
        return world.deformed(shot.field, grid=self._grid_wanted)

    def _complain(self, line: str) -> None:
        self._from_thread({"type": "notice", "level": "fault", "message": line})

    def _from_thread(self, message: dict[str, Any]) -> None:
        self._call(self._tell, message)

    def _call(self, function: Callable[[Any], None], message: Any) -> None:
        """Have something done in the socket's loop; nothing where that has ended."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(function, message)

    def _tell(self, message: dict[str, Any]) -> None:
        self._put(json.dumps(message, allow_nan=False))

    def _put(self, message: str | bytes) -> None:
        try:
            self._outbox.put_nowait(message)
        except asyncio.QueueFull:
            self.deaf = True

    def _refuse(
        self, what: str, problem: str, *, seq: int | None = None, file: str | None = None, line: int | None = None
    ) -> None:
        message = {"type": "refused", "what": what, "message": problem, "file": file, "line": line}
        self._tell(message if seq is None else message | {"seq": seq})
        now = time.monotonic()
        self._refusals.append(now)
        if len(self._refusals) == MOST_REFUSALS and now - self._refusals[0] < REFUSALS_S:
            raise MisbehaviourError(POLICY, f"{MOST_REFUSALS} refusals within {REFUSALS_S:g} s")

"""A session that runs for one page: its thread, its frames and its meshes."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from msgspec import structs

from ..simulator.runner import Runner
from ..simulator.stamp import Stamp
from .client_messages import MessageError
from .flow import FrameFlow
from .scene_catalog import SceneCatalog
from .sender import Sender

if TYPE_CHECKING:
    from ..simulator.command import Command
    from ..simulator.console_frame import ConsoleFrame
    from .stage import Stage

logger = logging.getLogger(__name__)

Watch = Callable[[Runner[Any]], object]
"""Called with the runner of every session, by whoever else shows it."""

_POLL_S = 0.005
MOST_ACTIONS = 240
"""Actions that may wait for a page that draws no frames."""


class LiveSession:
    """What a page works on; frames are made and encoded in the session's thread, all else happens in the socket's loop.

    Parameters
    ----------
    name : str
        Id of its scene.
    stage : Stage
        What it works on: touched by its own thread alone from now on.
    flow : FrameFlow
        Numbers and credit of the page's frames; they go on from scene to scene.
    sender : Sender
        Who says what to the page.
    catalog : SceneCatalog
        Who makes the meshes.
    watch : callable, optional
        Called with its runner: who else shows it.
    """

    def __init__(
        self, name: str, stage: Stage, flow: FrameFlow, sender: Sender, catalog: SceneCatalog,
        watch: Watch | None = None,
    ) -> None:  # fmt: skip
        self.name, self.stage, self.console = name, stage, stage.console
        self._flow, self._sender, self._catalog = flow, sender, catalog
        self._showing: asyncio.Task[None] | None = None
        self.ended = False
        """Whether it takes nothing any more."""
        flow.begin(self.console)
        self._runner = Runner(stage)
        self._frames = self._runner.subscribe(self._deliver, on_error=sender.report, ready=flow.may_send, quick=True)
        if watch is not None:
            watch(self._runner)

    def submit(self, command: Command, seq: int) -> None:
        """Give a command.

        Raises
        ------
        ValueError
            One beyond the scene's limits, or not part of an exercise.
        """
        self.stage.check(command)
        self._runner.submit(command, seq)

    def freeze(self, on: bool) -> None:
        """Have time stand still, or go on, whatever the page asks for."""
        self._runner.amend(lambda command: structs.replace(command, frozen=on))

    def act(self, action: Callable[[Stage], object]) -> None:
        """Have something else done to the stage.

        Raises
        ------
        MessageError
            Too much waits already.
        """
        if self._runner.waiting >= MOST_ACTIONS:
            raise MessageError("message", f"comes after {MOST_ACTIONS} that wait; say which frames were drawn")
        self._runner.do(action)

    def look_again(self) -> None:
        """Have another frame, where nothing else asks for one."""
        self.act(_nothing)

    def wake(self) -> None:
        """Look again whether a frame is welcome."""
        self._frames.wake()

    async def end(self) -> None:
        """End the thread, once it is out of the step it is in."""
        self.ended = True
        self._runner.stop()
        if self._showing is not None:
            self._showing.cancel()
            await asyncio.gather(self._showing, return_exceptions=True)
        while self._runner.alive:
            await asyncio.sleep(_POLL_S)

    def _deliver(self, frame: ConsoleFrame, stamp: Stamp) -> None:
        """Encode a frame; in the session's thread."""
        self._sender.call(self._sender.put, self._flow.encode(self.stage, frame, stamp))
        if self._flow.at_first:  # nothing shall keep the first picture waiting
            self._sender.call(self._show, stamp)

    def _show(self, _: Stamp) -> None:
        if not self.ended:
            self._showing = asyncio.create_task(self._bring_meshes())

    async def _bring_meshes(self) -> None:
        if "3-D view" not in self.stage.guides:
            self._catalog.prepare_push(self.console, lambda: not self.ended)
            return
        try:
            made = self._catalog.geometry(self.console, lambda: not self.ended)
            geometry = await asyncio.wrap_future(made)
        except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
            logger.warning("the surfaces of a scene could not be made: %s", error)
            self._sender.report(f"the 3-D view has no surfaces: {error}")
            return
        self._sender.put(geometry)
        self._flow.meshes.show(self.console.scene)
        self._runner.do(_nothing)  # where nothing moves, the positions come by one more frame


def _nothing(stage: Stage) -> None:
    """Ask nothing of a stage but another frame."""

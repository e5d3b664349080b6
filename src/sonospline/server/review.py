"""The debrief of one page: what its attempt came to, and its pictures made again."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..training.comments import Comment as KeptComment
from ..training.comments import add_comment, read_comments
from .scene_catalog import SceneCatalog
from .sender import Sender
from .server_messages import Comment, Comments, Refused
from .wire import ReplayedStep
from .worker import Worker

if TYPE_CHECKING:
    from ..training.replay_player import ReplayPlayer
    from .flow import FrameFlow
    from .live_attempt import LiveAttempt
    from .live_session import LiveSession

logger = logging.getLogger(__name__)


class Review:
    """Says what an attempt came to, and shows steps of its recording as they are asked for.

    Parameters
    ----------
    live : LiveSession
        Of the attempt; it is ended first.
    attempt : LiveAttempt
        That has come to its debrief.
    catalog : SceneCatalog
        Who makes the meshes.
    flow : FrameFlow
        Numbers of the page's frames; they go on.
    sender : Sender
        Who says what to the page.
    """

    def __init__(
        self, live: LiveSession, attempt: LiveAttempt, catalog: SceneCatalog, flow: FrameFlow, sender: Sender
    ) -> None:
        self._attempt, self._catalog, self._flow, self._sender = attempt, catalog, flow, sender
        self._worker = Worker("sonospline-review")
        self._player: ReplayPlayer | None = None
        self._wanted: int | None = None
        self._ended = False
        self._task = asyncio.create_task(self._begin(live))

    def show(self, step: int) -> None:
        """Have a step of the recording shown; one that was not looked at yet is forgotten."""
        self._wanted = step
        if not self._ended:
            self._worker.submit(self._show)

    def comment(self, time_s: float, text: str) -> None:
        """Keep what is said of a moment beside the recording, and tell the page."""
        if not self._ended:
            self._worker.submit(self._comment, time_s, text)

    async def end(self) -> None:
        """Show nothing any more."""
        self._ended = True
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        await asyncio.to_thread(self._worker.close, _LAST_STEP_S)

    async def _begin(self, live: LiveSession) -> None:
        from .debrief import debrief_of, player_of

        await live.end()
        try:
            player, problem = await self._in_worker(lambda: player_of(self._attempt))
            self._player = player
            self._sender.say(await self._in_worker(lambda: debrief_of(self._attempt, player, problem)))
            self._tell(await self._in_worker(lambda: read_comments(self._attempt.recording.path)))
            self.show(len(self._attempt.commands) - 1)
            self._worker.submit(self._make_ahead, 0)
            geometry = await asyncio.wrap_future(self._catalog.geometry(live.console, lambda: not self._ended))
            self._sender.put(geometry)
        except Exception as error:  # the page says so, and can begin again
            logger.exception("a debrief could not be made")
            self._sender.report(f"the debrief could not be made: {error}")

    def _comment(self, time_s: float, text: str) -> None:
        try:
            self._sender.call(self._tell, add_comment(self._attempt.recording.path, time_s, text))
        except (ValueError, OSError) as error:
            self._sender.say_from_thread(Refused(what="add_comment", message=f"is not kept: {error}"))

    def _tell(self, comments: tuple[KeptComment, ...]) -> None:
        if comments:
            self._sender.say(Comments(comments=tuple(Comment(time_s=one.time_s, text=one.text) for one in comments)))

    async def _in_worker(self, job: Callable[[], Any]) -> Any:
        return await asyncio.wrap_future(self._worker.submit(job))

    def _show(self) -> None:
        """Make the step that was asked for last, and send it; in the worker."""
        step, self._wanted = self._wanted, None
        if step is None or self._ended:
            return
        try:
            self._sender.call(self._sender.put, self._picture(step))
        except Exception as error:
            logger.exception("a step could not be made again")
            self._sender.say_from_thread(Refused(what="show_step", message=f"could not be made again: {error}"))

    def _make_ahead(self, step: int) -> None:
        """Make some steps nobody has asked for yet, so that a jump finds one to go on from; in the worker."""
        player = self._player
        if player is None or self._ended:
            return
        for place in range(step, min(step + _AHEAD, len(player.recording.steps))):
            player.at(place)
            player.pin(place)
        if step + _AHEAD < len(player.recording.steps):
            with contextlib.suppress(RuntimeError):  # closed
                self._worker.submit(self._make_ahead, step + _AHEAD)

    def _picture(self, step: int) -> bytes:
        from ..simulator.console_frame import seen_from_skin
        from ..simulator.pass_metrics import PassMetrics

        attempt, last = self._attempt, len(self._attempt.commands) - 1
        step = min(step, last)
        if self._player is None or step >= min(last, len(self._player.recording.steps)):  # the last picture is here
            shown = attempt.last
            replay = ReplayedStep(step=last, time_s=shown.time_s, same=True)
            return self._flow.encode_replayed(shown, replay, passes=shown.metrics.passes)
        made = self._player.at(step)
        shown = seen_from_skin(made.frame, attempt.console.scene, attempt.commands[step], metrics=PassMetrics())
        replay = ReplayedStep(step=step, time_s=made.frame.time_s, same=made.same)
        return self._flow.encode_replayed(shown, replay, passes=attempt.last.metrics.passes)


_AHEAD = 4
"""Steps that are made ahead at a time: what is asked for waits no longer."""
_LAST_STEP_S = 1.0
"""How long an end waits for a step that is under way."""

"""Frames on their way to one page: their numbers, its credit, and which meshes it has."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING

from ..training.guide import ALL_GUIDES
from . import wire
from .client_messages import MessageError
from .mesh_flow import MeshFlow
from .seat import Seat
from .wire import PassSummary, ReplayedStep

if TYPE_CHECKING:
    from ..simulator.console import Console
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.stamp import Stamp
    from .stage import Stage

MESH_HZ = 15.0


class FrameFlow:
    """Encodes frames, no more than a page draws, with mesh positions where the tissue moved.

    Frames are encoded in the session's thread; the rest happens in the socket's loop.

    Parameters
    ----------
    seat : Seat, optional
        Who sees them, too.
    """

    def __init__(self, seat: Seat | None = None) -> None:
        self._seat = Seat() if seat is None else seat
        self._flying: deque[int] = deque()
        self._frames = self._of_older_scenes = 0
        self._ahead = 1
        self.meshes = MeshFlow(MESH_HZ)

    def begin(self, console: Console) -> None:
        """Go on with a console's frames; the page has no meshes of it yet."""
        self._flying.clear()
        self._of_older_scenes = self._frames
        self.meshes.begin(console)

    def view(self, grid: bool, ahead: int) -> None:
        """Heed what the page shows and how far frames may be ahead of it."""
        self.meshes.grid_wanted, self._ahead = grid, ahead

    def may_send(self) -> bool:
        """Return whether another frame is welcome."""
        return len(self._flying) <= self._ahead

    def drawn(self, frame: int) -> None:
        """Take a frame and those before it for drawn.

        Raises
        ------
        MessageError
            It is not on its way.
        """
        if frame <= self._of_older_scenes:
            return
        if frame not in self._flying:
            raise MessageError("drawn", f"frame = {frame} is not in flight; say once that a frame was drawn")
        while self._flying and self._flying[0] <= frame:
            self._flying.popleft()

    def encode(self, stage: Stage, shown: ConsoleFrame, stamp: Stamp) -> bytes:
        """Return the message of a picture."""
        self._seat.saw(shown, None)
        positions = self.meshes.positions(stage.console.scene, shown)
        self._frames += 1
        self._flying.append(self._frames)
        return wire.frame(
            shown, number=self._frames, seq=stamp.seq, guides=stage.guides, summary=stage.summary(shown),
            positions=positions,
            grid=positions is not None and self.meshes.has_grid, server_ms=1e3 * (time.perf_counter() - stamp.since),
        )  # fmt: skip

    def encode_replayed(self, shown: ConsoleFrame, replay: ReplayedStep, *, passes: int) -> bytes:
        """Return the message of a picture of a recording, with everything that was hidden while it was made."""
        self._seat.saw(shown, replay)
        self._frames += 1
        self._flying.append(self._frames)
        summary = PassSummary(time_s=replay.time_s, passes=passes, path_mm=None, blind_mm=None)
        return wire.frame(
            shown, number=self._frames, seq=0, guides=ALL_GUIDES, summary=summary, replay=replay
        )  # fmt: skip

    @property
    def at_first(self) -> bool:
        """Whether the newest frame is the first of its scene."""
        return self._frames == self._of_older_scenes + 1

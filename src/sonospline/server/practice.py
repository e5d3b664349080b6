"""Free practice: a console, and what its present pass looks like."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..training.guide import ALL_GUIDES
from ..training.pass_meter import PassMeter
from .wire import PassSummary

if TYPE_CHECKING:
    from ..simulator.command import Command
    from ..simulator.console import Console
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.scene import Scene
    from ..simulator.session import Session
    from ..training.guide import Guide


class Practice:
    """A console that nothing is asked of.

    Parameters
    ----------
    console : Console
        Its own from now on.
    """

    exercise = None
    over = False

    def __init__(self, console: Console) -> None:
        self.guides: frozenset[Guide] = ALL_GUIDES
        """What may be shown beside the image."""
        self.console = console
        self._meter = PassMeter()

    @property
    def scene(self) -> Scene:
        """The console's."""
        return self.console.scene

    @property
    def session(self) -> Session:
        """The console's."""
        return self.console.session

    @property
    def command(self) -> Command:
        """The command in force."""
        return self.console.command

    @property
    def start(self) -> Command:
        """Where it began."""
        return self.console.scene.start

    @property
    def last(self) -> ConsoleFrame | None:
        """The frame in force."""
        return self.console.last

    def step(self, command: Command | None = None, dt: float = 0.0) -> ConsoleFrame:
        """Come to a command, some time later."""
        frame = self.console.step(command, dt)
        self._meter.add(frame)
        return frame

    def check(self, command: Command) -> None:
        """Raise FieldError where a command is beyond the scene's limits."""
        self.console.scene.check(command)

    def summary(self, frame: ConsoleFrame) -> PassSummary:
        """Return what a page says of the pass; numbers of the tip only where these may be shown."""
        if "numbers" in self.guides:
            return self.measured(frame)
        return PassSummary(time_s=frame.metrics.time_s, passes=frame.metrics.passes, path_mm=None, blind_mm=None)

    def measured(self, frame: ConsoleFrame) -> PassSummary:
        """Return what is known of the pass."""
        path, blind = self._meter.found(frame.time_s)
        return PassSummary(time_s=frame.metrics.time_s, passes=frame.metrics.passes, path_mm=path, blind_mm=blind)

    def pause(self) -> None:
        """Let nothing happen until the next step."""
        self.console.pause()

    def close(self) -> None:
        """Nothing is to be ended."""

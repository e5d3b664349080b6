"""What a page works on: free practice, or an attempt."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from ..simulator.command import Command
    from ..simulator.console import Console
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.scene import Scene
    from ..training.guide import Guide
    from .wire import PassSummary


class Stage(Protocol):
    """A console with what is asked of its hand."""

    @property
    def console(self) -> Console:
        """What is worked on."""

    @property
    def scene(self) -> Scene:
        """What it is in."""

    @property
    def exercise(self) -> str | None:
        """Id of the exercise; None in free practice."""

    @property
    def guides(self) -> frozenset[Guide]:
        """What may be shown beside the image."""

    @property
    def command(self) -> Command:
        """The command in force."""

    @property
    def start(self) -> Command:
        """Where it began."""

    @property
    def last(self) -> ConsoleFrame | None:
        """The frame in force."""

    @property
    def over(self) -> bool:
        """Whether it has come to its end."""

    def step(self, command: Command | None = None, dt: float = 0.0) -> ConsoleFrame:
        """Come to a command, some time later."""

    def check(self, command: Command) -> None:
        """Raise ValueError where a command is beyond its limits."""

    def summary(self, frame: ConsoleFrame) -> PassSummary:
        """Return what a page says of the pass."""

    def measured(self, frame: ConsoleFrame) -> PassSummary:
        """Return what is known of the pass, shown or not."""

    def pause(self) -> None:
        """Let nothing happen until the next step."""

    def close(self) -> None:
        """Nobody goes on with it."""

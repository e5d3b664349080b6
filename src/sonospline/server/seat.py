"""Who sits at a connection: anybody, or in a lab a participant at a station."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from .client_messages import Message, MessageError

if TYPE_CHECKING:
    from ..simulator.command import Command
    from ..simulator.console_frame import ConsoleFrame
    from .sender import Sender
    from .stage import Stage
    from .wire import ReplayedStep


class SeatedPage(Protocol):
    """What a seat knows of the connection that has it."""

    key: str
    sender: Sender

    def freeze(self, on: bool) -> None:
        """Have time stand still, or go on."""

    async def begin_again(self) -> None:
        """Let the page go on with what it works on as if it had just come."""


class Seat:
    """A place that asks nothing and keeps nothing; a lab's stations are made of it.

    Everything happens in the socket's loop, but for :meth:`saw`.
    """

    def take(self, page: SeatedPage) -> None:
        """A page has come, and was greeted."""

    def leave(self, page: SeatedPage) -> None:
        """It has gone."""

    def refusal(self, message: Message) -> str | None:
        """Return why a message is not heeded here, None where it is."""

    def heeded(self, command: Command) -> Command:
        """Return what is made of a command."""
        return command

    def sit_down(self, participant: str | None) -> None:
        """Somebody says who sits here; None for nobody any more."""
        raise MessageError("sit_down", "is for the stations of a lab; start the server with --lab")

    def began(self, name: str, stage: Stage) -> None:
        """Something is worked on from now on."""

    def saw(self, shown: ConsoleFrame, replay: ReplayedStep | None) -> None:
        """A picture is on its way to the page; in the thread that made it."""

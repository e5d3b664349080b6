"""What a client may say: JSON texts, checked."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from .._shown import shown
from ..simulator._fields import FieldError, read, told
from ..simulator.command import Command, ImageSettings, NeedleCommand, ProbeCommand

LONGEST = 64 * 1024
MOST_SEQ = 2**53
"""The largest number every JSON reader takes for the same."""


class MessageError(ValueError):
    """A message that is refused: what it was about, and its number where it has one."""

    def __init__(self, what: str, problem: str, seq: int | None = None) -> None:
        self.what, self.seq = what, seq
        super().__init__(problem)


@dataclass(frozen=True, kw_only=True)
class State:
    """The whole command, absolute."""

    seq: int = told("number, larger than the last", low=0, high=MOST_SEQ)
    needle: NeedleCommand = told("needle")
    probe: ProbeCommand = told("probe")
    image: ImageSettings = told("image")
    frozen: bool = told("freeze")

    @property
    def command(self) -> Command:
        """The command in it."""
        return Command(needle=self.needle, probe=self.probe, image=self.image, frozen=self.frozen)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A frame was drawn: credit for another one."""

    frame: int = told("number of the frame", low=0, high=MOST_SEQ)


@dataclass(frozen=True, kw_only=True)
class Model:
    """Let another model answer."""

    model: str = told("paper, kelvinlet or elastic")


@dataclass(frozen=True, kw_only=True)
class ChooseScene:
    """Load another scene."""

    id: str = told("one of those in hello")


@dataclass(frozen=True, kw_only=True)
class OpenScene:
    """Load a scene file of the user's."""

    name: str = told("its file's name", longest=255)
    text: str = told("its text", longest=LONGEST)


@dataclass(frozen=True, kw_only=True)
class Target:
    """Aim for another target."""

    id: str = told("one of the scene's")


@dataclass(frozen=True, kw_only=True)
class UndoPass:
    """Take the needle out and forget the pass."""


@dataclass(frozen=True, kw_only=True)
class Reset:
    """Everything to the scene's start."""


@dataclass(frozen=True, kw_only=True)
class Restore:
    """Undo a reset."""


@dataclass(frozen=True, kw_only=True)
class View:
    """What the page shows, and how."""

    grid: bool = told("whether positions of the grid lines are wanted")
    ahead: int = told("frames that may come before the last one was drawn", low=0, high=1, default=1)


@dataclass(frozen=True, kw_only=True)
class Ping:
    """Asks for a sign of life: frames may take long, the connection does not."""


Message = State | Drawn | Model | ChooseScene | OpenScene | Target | UndoPass | Reset | Restore | View | Ping

KINDS: dict[str, type[Any]] = {
    "state": State, "drawn": Drawn, "model": Model, "scene": ChooseScene, "open_scene": OpenScene, "target": Target,
    "undo_pass": UndoPass, "reset": Reset, "restore": Restore, "view": View, "ping": Ping,
}  # fmt: skip


def parse(text: str) -> Message:
    """Return the message in a text.

    Raises
    ------
    MessageError
        Not JSON, an unknown type, an unknown or missing key, NaN, or a value of the wrong kind.
    """
    try:
        values = json.loads(text, object_pairs_hook=_object)
    except MessageError:
        raise
    except (ValueError, RecursionError):
        raise MessageError("message", "is not JSON; send one JSON object a message") from None
    if not isinstance(values, dict):
        raise MessageError("message", "is no JSON object; send one with a type")
    name = values.pop("type", None)
    if not isinstance(name, str) or name not in KINDS:
        raise MessageError("message", f"type = {shown(name)} is not known; send one of {', '.join(KINDS)}")
    try:
        message: Message = read(KINDS[name], values)
    except FieldError as error:
        raise MessageError(name, str(error), _number_of(values)) from None
    return message


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a JSON object; a key that comes twice has no meaning."""
    values = dict(pairs)
    if len(values) < len(pairs):
        key = next(key for k, (key, _) in enumerate(pairs) if key in dict(pairs[:k]))
        raise MessageError("message", f"holds {shown(key)} twice; give each key once")
    return values


def _number_of(values: dict[str, Any]) -> int | None:
    """Return the number of a state that was refused, where it is one."""
    seq = values.get("seq")
    return seq if isinstance(seq, int) and not isinstance(seq, bool) and 0 <= seq <= MOST_SEQ else None

"""What a client may say: JSON texts, checked."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Annotated, Any, get_args

from .._shown import shown
from ..io.records import FieldError, Record, Text, about, read
from ..simulator.command import Command, ImageSettings, NeedleCommand, ProbeCommand
from ..simulator.tissue_settings import TissueSettings
from ..training.comments import LONGEST_COMMENT

LONGEST = 64 * 1024
MOST_SEQ = 2**53
"""The largest number every JSON reader takes for the same."""


class MessageError(ValueError):
    """A message that is refused: what it was about, and its number where it has one."""

    def __init__(self, what: str, problem: str, seq: int | None = None) -> None:
        self.what, self.seq = what, seq
        super().__init__(problem)


def snake_case(name: str) -> str:
    """Return the ``type`` of a message from the name of its class."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


class ClientMessage(Record, frozen=True, tag=snake_case):
    """A message by its ``type``: the name of its class."""


class CommandMessage(ClientMessage, frozen=True, kw_only=True, tag="command"):
    """The whole command, absolute."""

    seq: Annotated[int, about("number, larger than the last", low=0, high=MOST_SEQ)]
    needle: NeedleCommand
    probe: ProbeCommand
    image: ImageSettings
    frozen: Annotated[bool, about("freeze")]
    tissue: TissueSettings | None = None

    @property
    def command(self) -> Command:
        """The command in it."""
        return Command(needle=self.needle, probe=self.probe, image=self.image, tissue=self.tissue, frozen=self.frozen)


class Drawn(ClientMessage, frozen=True, kw_only=True):
    """A frame was drawn: credit for another one."""

    frame: Annotated[int, about("number of the frame", low=0, high=MOST_SEQ)]


class ChooseModel(ClientMessage, frozen=True, kw_only=True, tag="model"):
    """Let another model answer."""

    model: Annotated[Text, about("one of those in scene")]


class ChooseScene(ClientMessage, frozen=True, kw_only=True, tag="scene"):
    """Load another scene."""

    id: Annotated[Text, about("one of those in hello")]


class OpenScene(ClientMessage, frozen=True, kw_only=True):
    """Load a scene file of the user's."""

    name: Annotated[str, about("its file's name", longest=255)]
    text: Annotated[str, about("its text", longest=LONGEST)]


class ChooseTarget(ClientMessage, frozen=True, kw_only=True, tag="target"):
    """Aim for another target."""

    id: Annotated[Text, about("one of the scene's")]


class UndoPass(ClientMessage, frozen=True, kw_only=True):
    """Take the needle out and forget the pass."""


class Reset(ClientMessage, frozen=True, kw_only=True):
    """Everything to the scene's start."""


class Restore(ClientMessage, frozen=True, kw_only=True):
    """Undo a reset."""


class ListExercises(ClientMessage, frozen=True, kw_only=True):
    """Asks which exercises there are."""


class BeginAttempt(ClientMessage, frozen=True, kw_only=True):
    """Begin an attempt at an exercise; what runs is given up."""

    exercise: Annotated[Text, about("id of one of those on offer")]
    seed: (
        Annotated[int, about("of the start, for the same one again; by default drawn", low=0, high=2**32 - 1)] | None
    ) = None


class OnTarget(ClientMessage, frozen=True, kw_only=True):
    """The trainee says that the needle is on target: the attempt ends."""


class GiveUp(ClientMessage, frozen=True, kw_only=True):
    """The trainee gives the attempt up."""


class ShowStep(ClientMessage, frozen=True, kw_only=True):
    """In a debrief: show a step of the recording; the newest one counts."""

    step: Annotated[int, about("its place in the recording", low=0, high=MOST_SEQ)]


class AddComment(ClientMessage, frozen=True, kw_only=True):
    """In a debrief: keep what is said of a moment beside the recording."""

    time_s: Annotated[float, about("since the attempt began, s", low=0, high=1e6)]
    text: Annotated[str, about("what is to be said", longest=LONGEST_COMMENT)]


class SitDown(ClientMessage, frozen=True, kw_only=True):
    """At a station of a lab: who sits there from now on."""

    participant: Annotated[Text, about("code of a participant; none for nobody")] | None


class View(ClientMessage, frozen=True, kw_only=True):
    """What the page shows, and how."""

    grid: Annotated[bool, about("whether positions of the grid lines are wanted")]
    ahead: Annotated[int, about("frames that may come before the last one was drawn", low=0, high=1)] = 1


class Ping(ClientMessage, frozen=True, kw_only=True):
    """Asks for a sign of life: frames may take long, the connection does not."""


Message = (
    CommandMessage | Drawn | ChooseModel | ChooseScene | OpenScene | ChooseTarget | UndoPass | Reset | Restore | View
    | ListExercises | BeginAttempt | OnTarget | GiveUp | ShowStep | AddComment | SitDown | Ping
)  # fmt: skip

KINDS: dict[str, type[Any]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Message)}


def parse(kinds: Mapping[str, type[Any]], text: str) -> Any:
    """Return the message in a text, of one of some kinds by their types.

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
    name = values.get("type")
    if not isinstance(name, str) or name not in kinds:
        raise MessageError("message", f"type = {shown(name)} is not known; send one of {', '.join(kinds)}")
    try:
        return read(kinds[name], values)
    except FieldError as error:
        raise MessageError(name, str(error), _number_of(values)) from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a JSON object; a key that comes twice has no meaning."""
    values = dict(pairs)
    if len(values) < len(pairs):
        key = next(key for k, (key, _) in enumerate(pairs) if key in dict(pairs[:k]))
        raise MessageError("message", f"holds {shown(key)} twice; give each key once")
    return values


def _number_of(values: dict[str, Any]) -> int | None:
    """Return the number of a command that was refused, where it is one."""
    seq = values.get("seq")
    return seq if isinstance(seq, int) and not isinstance(seq, bool) and 0 <= seq <= MOST_SEQ else None

"""Commands as clients of PLUS send them: in a STRING from ``CMD_<number>``, or in a COMMAND; and their replies."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import NamedTuple
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from .. import igtl
from .._shown import shown
from .link_connection import Connection

_PREFIX, _REPLY = "CMD_", "ACK_"
_REMEMBERED = 10
"""Numbers of commands by which a repeated one is known, as in PLUS."""
_FAILED = "Command failed. See error message."


class PlusCommand(NamedTuple):
    """A command: its number and name, the attributes of its XML, and the parameters in it."""

    number: str
    name: str
    attributes: Mapping[str, str]
    parameters: Mapping[str, str]
    device: str
    as_message: bool
    """Whether it came in a COMMAND."""

    def attribute(self, name: str) -> str:
        """Return an attribute; ValueError where it was left out."""
        if name not in self.attributes:
            raise ValueError(f"{self.name} has no attribute {name}; give it")
        return self.attributes[name]


class Outcome(NamedTuple):
    """What a command came to: a text, and values by name; ``xml`` where its reply has a form of its own."""

    text: str
    values: Mapping[str, str] = {}
    ok: bool = True
    error: str = ""
    xml: str = ""


Action = Callable[[PlusCommand], Outcome | Future[Outcome]]
"""What does a command: at once, or by a thread of its own, and then the reply waits for it."""


class CommandDesk:
    """Does what commands ask for, once each; what it cannot do it says in the reply.

    Parameters
    ----------
    actions : mapping of str to callable
        By names of commands, whose case does not matter. A ValueError of theirs is the reply's error.
    """

    def __init__(self, actions: Mapping[str, Action]) -> None:
        self._actions = {name.lower(): action for name, action in actions.items()}
        self._done: weakref.WeakKeyDictionary[Connection, deque[str]] = weakref.WeakKeyDictionary()

    def answer(self, message: igtl.Message, client: Connection) -> list[igtl.Message] | None:
        """Return the reply to a command, nothing to a repeated one; None where the message is no command."""
        if not is_command(message):
            return None
        number = _number(message)
        done = self._done.setdefault(client, deque(maxlen=_REMEMBERED))
        if number in done:
            return []
        done.append(number)
        try:
            command = command_of(message)
            outcome = self._done_by(command)
        except (ValueError, OSError) as error:
            return [reply(_nameless(message), _failed(error))]
        if isinstance(outcome, Outcome):
            return [reply(command, outcome)]
        outcome.add_done_callback(lambda done: client.answer_soon(reply(command, _outcome_of(done))))
        return []

    def _done_by(self, command: PlusCommand) -> Outcome | Future[Outcome]:
        action = self._actions.get(command.name.lower())
        if action is None:
            return Outcome(_FAILED, ok=False, error=f"Unknown command: {shown(command.name)}")
        return action(command)


def _failed(error: BaseException) -> Outcome:
    """Say why; of the system's errors without the path, which is nobody's business."""
    why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return Outcome(_FAILED, ok=False, error=why)


def _outcome_of(done: Future[Outcome]) -> Outcome:
    error = done.exception()
    return done.result() if error is None else _failed(error)


def is_command(message: igtl.Message) -> bool:
    """Return whether a message is a command, in either form."""
    content = message.content
    if isinstance(content, igtl.Command) and not isinstance(content, igtl.CommandReply):
        return True
    return isinstance(content, igtl.String) and message.device.upper().startswith(_PREFIX)


def command_of(message: igtl.Message) -> PlusCommand:
    """Return the command of a message.

    Raises
    ------
    ValueError
        Its text is no XML, or declares entities.
    """
    content, bare = message.content, _nameless(message)
    text = content.text if isinstance(content, igtl.String | igtl.Command) else ""
    if not text.strip():
        return bare
    if "<!" in text:
        raise ValueError("the command declares entities; leave them out")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"the command is no XML: {error}") from None
    parameters = {
        element.attrib["Name"]: element.attrib.get("Value", "") for element in root if "Name" in element.attrib
    }
    return bare._replace(name=bare.name or root.attrib.get("Name", ""), attributes=root.attrib, parameters=parameters)


def reply(command: PlusCommand, outcome: Outcome) -> igtl.Message:
    """Return the message that says what a command came to, in the form of the command."""
    status = "SUCCESS" if outcome.ok else "FAIL"
    if not command.as_message:
        said = outcome.xml or " ".join(filter(None, (outcome.text, outcome.error)))
        xml = f'<CommandReply Status="{status}" Message={quoteattr(said)} />'
        return igtl.Message(igtl.String(xml), f"{_REPLY}{command.number}", igtl.now())
    error = "" if outcome.ok else f" Error={quoteattr(outcome.error)}"
    xml = outcome.xml or (
        f'<CommandReply Name={quoteattr(command.name)} Status="{status}"{error}'
        f" Message={quoteattr(outcome.text)}></CommandReply>"
    )
    metadata = {"Message": outcome.text, **outcome.values, "Status": status}
    if not outcome.ok:
        metadata |= {"Error": outcome.error, "ErrorMessage": outcome.error}  # as PLUS, and as 3D Slicer reads it
    content = igtl.CommandReply(int(command.number), command.name, xml)
    return igtl.Message(content, command.device, igtl.now(), metadata)


def parameters_xml(values: Mapping[str, str | None], *, shows: bool) -> str:
    """Return the reply to a command about parameters: each with its value, or None where it failed."""
    parts = []
    for name, value in values.items():
        success = "false" if value is None else "true"
        shown_value = f" Value={quoteattr(value)}" if shows and value is not None else ""
        parts.append(f'<Parameter Name={quoteattr(name)} Success="{success}"{shown_value} />')
    return f"<CommandReply>{''.join(parts)}</CommandReply>"


def _number(message: igtl.Message) -> str:
    if isinstance(message.content, igtl.Command):
        return str(message.content.number)
    return message.device[len(_PREFIX) :]


def _nameless(message: igtl.Message) -> PlusCommand:
    content = message.content
    name = content.name if isinstance(content, igtl.Command) else ""
    return PlusCommand(_number(message), name, {}, {}, message.device, isinstance(content, igtl.Command))

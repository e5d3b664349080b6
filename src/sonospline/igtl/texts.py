"""STRING, STATUS, CAPABILITY, COMMAND and its reply: messages of words."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from typing import ClassVar, Self

from .._shown import shown
from .content import Content
from .errors import ContentError
from .wire import Reader, field, layout, text_of, whole

ASCII, UTF8 = 3, 106
_ENCODINGS = {ASCII: "utf-8", 4: "latin-1", UTF8: "utf-8", 1013: "utf-16-be", 1014: "utf-16-le", 1015: "utf-16"}
"""By the numbers that IANA gives them; many send UTF-8 as ASCII."""
_MOST_TEXT, _MOST_COMMAND = 0xFFFF, 1 << 20
_TYPE, _NAME, _COMMAND_NAME = 12, 20, 128


def encoded(text: str) -> tuple[int, bytes]:
    """Return the number of a text's encoding, and its bytes."""
    return (ASCII if text.isascii() else UTF8), text.encode(errors="replace")


def decoded(what: str, encoding: int, text: bytes | memoryview) -> str:
    """Return the text of bytes; ContentError where its encoding is not known, or not what it says."""
    if encoding not in _ENCODINGS:
        raise ContentError(f"{what} has a text in encoding {encoding}; known are {', '.join(map(str, _ENCODINGS))}")
    try:
        return codecs.decode(bytes(text), _ENCODINGS[encoding])
    except UnicodeDecodeError as error:
        raise ContentError(f"{what} has a text that is no {_ENCODINGS[encoding]}: {error.reason}") from None


@dataclass(frozen=True, eq=False, repr=False)
class String(Content):
    """A text.

    Parameters
    ----------
    text : str
        At most 65,535 bytes of UTF-8.

    Examples
    --------
    >>> from sonospline import igtl
    >>> igtl.String("the needle touches bone")
    String('the needle touches bone')
    """

    TYPE: ClassVar[str] = "STRING"
    text: str

    def __post_init__(self) -> None:
        _short("text", self.text, _MOST_TEXT)

    def packed(self) -> bytes:
        """Return encoding, length and text."""
        number, text = encoded(self.text)
        return layout("HH").pack(number, len(text)) + text

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        number, length = reader.fields("HH")
        return cls(decoded(reader.what, number, reader.bytes(length)))

    def __repr__(self) -> str:
        return f"String({shown(self.text)})"


@dataclass(frozen=True, eq=False, repr=False)
class Status(Content):
    """How the sender is.

    Parameters
    ----------
    code : int, default: 1
        1: well, 2: unknown error, 4: not found, 8: overflow, 12: unknown instruction, 13: not ready, 15: disabled,
        18: hardware, 19: about to end, and others of the protocol.
    message : str, optional
    name : str, default: "OK"
        At most 20 bytes.
    subcode : int, default: 0
        The sender's own.

    Examples
    --------
    >>> from sonospline import igtl
    >>> igtl.Status(), igtl.Status(8, "3 messages were lost", "Overflow")
    (Status(1, 'OK'), Status(8, 'Overflow: 3 messages were lost'))
    """

    TYPE: ClassVar[str] = "STATUS"
    code: int = 1
    message: str = ""
    name: str = "OK"
    subcode: int = 0

    def __post_init__(self) -> None:
        whole("code", self.code, 0xFFFF)
        field("name", self.name, _NAME)
        field("message", self.message, _MOST_TEXT)
        whole("subcode", self.subcode, (1 << 63) - 1, -(1 << 63))

    def packed(self) -> bytes:
        """Return codes, name and message, which ends with a zero."""
        front = layout("Hq20s").pack(self.code, self.subcode, field("name", self.name, _NAME))
        return front + field("message", self.message, _MOST_TEXT) + b"\0"

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        code, subcode, name = reader.fields("Hq20s")
        if reader.left > _MOST_TEXT + 1:
            raise ContentError(f"{reader.what} has a message of {reader.left} bytes; at most {_MOST_TEXT} are read")
        return cls(code, reader.text(reader.left), text_of(name), subcode)

    def __repr__(self) -> str:
        return f"Status({self.code}, {shown(': '.join(filter(None, (self.name, self.message))))})"


@dataclass(frozen=True, eq=False, repr=False)
class Capability(Content):
    """Which types of messages the sender reads.

    Parameters
    ----------
    types : iterable of str
        Each of at most 12 bytes.
    """

    TYPE: ClassVar[str] = "CAPABILITY"
    types: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "types", tuple(self.types))
        self.packed()

    def packed(self) -> bytes:
        """Return the names, twelve bytes each."""
        return b"".join(field("type", name, _TYPE).ljust(_TYPE, b"\0") for name in self.types)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        return cls(tuple(reader.text(_TYPE) for _ in range(-(-reader.left // _TYPE))))

    def __repr__(self) -> str:
        return f"Capability({len(self.types)} types)"


@dataclass(frozen=True, eq=False, repr=False)
class Command(Content):
    """Something to be done, with a number by which the reply names it. Only header version 2 knows these messages.

    Parameters
    ----------
    number : int
    name : str
        As PLUS calls it (``"GetTransform"``); at most 128 bytes.
    text : str
        XML with its arguments.

    Examples
    --------
    >>> from sonospline import igtl
    >>> igtl.Command(7, "RequestDeviceIds", '<Command Name="RequestDeviceIds" />')
    Command(7, 'RequestDeviceIds')
    """

    TYPE: ClassVar[str] = "COMMAND"
    number: int
    name: str
    text: str = ""

    def __post_init__(self) -> None:
        whole("number", self.number, (1 << 32) - 1)
        field("name", self.name, _COMMAND_NAME)
        _short("text", self.text, _MOST_COMMAND)

    def packed(self) -> bytes:
        """Return number, name, encoding, length and text."""
        encoding, text = encoded(self.text)
        name = field("name", self.name, _COMMAND_NAME)
        return layout("I128sHI").pack(self.number, name, encoding, len(text)) + text

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        number, name, encoding, length = reader.fields("I128sHI")
        return cls(number, text_of(name), decoded(reader.what, encoding, reader.bytes(length)))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.number}, {shown(self.name)})"


class CommandReply(Command):
    """What a :class:`Command` came to: its number and name, and XML."""

    TYPE: ClassVar[str] = "RTS_COMMAND"


def _short(name: str, text: str, most: int) -> None:
    if not isinstance(text, str):
        raise ValueError(f"{name} = {shown(text)} is not a text; give one")
    if len(text.encode(errors="replace")) > most:
        raise ValueError(f"{name} = {shown(text)} is longer than {most} bytes; shorten it")

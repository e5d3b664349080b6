"""GET_, STT_, STP_ and RTS_: ask for one message, start and stop a flow of them, and the answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from .._shown import shown
from .content import Content
from .errors import UnknownTypeError
from .wire import Reader, field, layout, whole

KINDS = (
    "TRANSFORM", "POSITION", "QTRANS", "TDATA", "QTDATA", "IMAGE", "IMGMETA", "LBMETA", "POLYDATA", "POINT", "STRING",
    "STATUS", "SENSOR", "NDARRAY", "CAPABILITY", "COMMAND",
)  # fmt: skip
"""What can be asked for."""
_SHORT = {"TRANSFORM": "TRANS", "CAPABILITY": "CAPABIL"}
"""As the C++ library writes them: a type has twelve bytes."""
_LONG = {**{kind: kind for kind in KINDS}, "TRANS": "TRANSFORM", "TRANSFOR": "TRANSFORM", "CAPABIL": "CAPABILITY"}
_COORDINATES = 32
_TRACKING, _MOST_MS = ("TDATA", "QTDATA"), (1 << 31) - 1
_NS_PER_MS = 1_000_000


@dataclass(frozen=True)
class Query(Content):
    """A message about messages of another type; those to ask with have the device's name, or none for any device.

    Parameters
    ----------
    of : str
        Type of the messages it is about (``"TRANSFORM"``).
    """

    PREFIX: ClassVar[str]
    of: str

    def __post_init__(self) -> None:
        if self.of not in KINDS:
            raise ValueError(f"of = {shown(self.of)} is not known; choose one of {', '.join(KINDS)}")

    @property
    def type(self) -> str:
        """The type of its messages, as headers have it."""
        return f"{self.PREFIX}_{_SHORT.get(self.of, self.of)}"

    def packed(self) -> bytes:
        """Return nothing: all is in the header."""
        return b""

    @classmethod
    def asked(cls, of: str, reader: Reader) -> Self:
        """Return what a body and the type in its header ask for."""
        return cls(of)


class Get(Query):
    """Ask for one message.

    Examples
    --------
    >>> from sonospline import igtl
    >>> igtl.Get("TRANSFORM"), igtl.Get("TRANSFORM").type
    (Get(of='TRANSFORM'), 'GET_TRANS')
    """

    PREFIX = "GET"


@dataclass(frozen=True)
class Start(Query):
    """Ask for a flow of messages.

    Parameters
    ----------
    of : str
    interval_ms : int, default: 0
        Least time between two; only those about TDATA, QTDATA and POLYDATA carry it.
    coordinates : str, optional
        In which coordinate system; at most 32 bytes. Only those about TDATA and QTDATA carry it.
    """

    PREFIX = "STT"
    interval_ms: int = 0
    coordinates: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        whole("interval_ms", self.interval_ms, _MOST_MS)
        field("coordinates", self.coordinates, _COORDINATES)
        if (self.interval_ms and self.of not in (*_TRACKING, "POLYDATA")) or (
            self.coordinates and self.of not in _TRACKING
        ):
            raise ValueError(f"STT_{self.of} carries no interval_ms or coordinates; only those of TDATA and QTDATA do")

    def packed(self) -> bytes:
        """Return the interval and the coordinate system, where they are carried."""
        if self.of in _TRACKING:
            return layout("I32s").pack(self.interval_ms, field("coordinates", self.coordinates, _COORDINATES))
        return layout("Q").pack(self.interval_ms * _NS_PER_MS) if self.of == "POLYDATA" and self.interval_ms else b""

    @classmethod
    def asked(cls, of: str, reader: Reader) -> Self:
        """Return what a body and the type in its header ask for."""
        if of in _TRACKING and reader.left:
            return cls(of, reader.fields("I")[0], reader.text(min(reader.left, _COORDINATES)))
        return cls(of, reader.fields("Q")[0] // _NS_PER_MS) if of == "POLYDATA" and reader.left else cls(of)


class Stop(Query):
    """Ask for the end of a flow of messages."""

    PREFIX = "STP"


@dataclass(frozen=True)
class Reply(Query):
    """The answer to :class:`Start` and :class:`Stop`.

    Parameters
    ----------
    of : str
    ok : bool, default: True
        Whether what was asked for is done.
    """

    PREFIX = "RTS"
    ok: bool = True

    def packed(self) -> bytes:
        """Return zero for success, else one."""
        return b"\0" if self.ok else b"\1"

    @classmethod
    def asked(cls, of: str, reader: Reader) -> Self:
        """Return what a body and the type in its header answer."""
        return cls(of, not reader.left or reader.fields("B")[0] == 0)


@dataclass(frozen=True)
class Nothing(Content):
    """The answer to :class:`Get` where there is no such data: a message of that type without a body.

    Parameters
    ----------
    of : str
        What was asked for.
    """

    of: str

    @property
    def type(self) -> str:
        """The type of its messages, as headers have it."""
        return self.of

    def packed(self) -> bytes:
        """Return nothing."""
        return b""


_QUERIES: dict[str, type[Query]] = {query.PREFIX: query for query in (Get, Start, Stop, Reply)}


def query_of(type_: str, reader: Reader) -> Query:
    """Return the query that a type and a body are; UnknownTypeError where the type is none."""
    prefix, _, of = type_.partition("_")
    if prefix not in _QUERIES or of not in _LONG:
        raise UnknownTypeError(f"{reader.what} is of no type that is known here")
    return _QUERIES[prefix].asked(_LONG[of], reader)

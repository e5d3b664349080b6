"""Messages and their bytes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from .. import _core
from .._by_value import ByValue
from .._shown import shown
from . import header as headers
from .content import Content
from .errors import ChecksumError, ContentError, SizeError, WireError
from .header import MOST_BODY, SIZE, VERSIONS, Header, check_version, parse_header
from .image import Image
from .lists import ImageList, LabelList, Points
from .numbers import NumberArray, Sensor
from .polydata import PolyData
from .poses import Position, QuaternionTrackingData, QuaternionTransform, TrackingData, Transform
from .queries import Nothing, query_of
from .stamp import MOST_STAMP
from .texts import Capability, Command, CommandReply, Status, String
from .wire import Reader, whole
from .wire import field as encoded_field

CONTENTS: Mapping[str, type[Content]] = {
    content.TYPE: content
    for content in (
        Transform, Position, QuaternionTransform, TrackingData, QuaternionTrackingData, Image, ImageList, LabelList,
        PolyData, Points, String, Status, Sensor, NumberArray, Capability, Command, CommandReply,
    )
}  # fmt: skip
"""What is known, by the types of messages; queries come beside them."""
_LISTS = (TrackingData, QuaternionTrackingData, ImageList, LabelList, Points, Capability)
"""Those whose body may be empty and say something."""


@dataclass(frozen=True, eq=False, repr=False)
class Message(ByValue):
    """A content, whose it is and of when.

    Parameters
    ----------
    content : Content
        :class:`Transform`, :class:`Image`, :class:`Get` and so on.
    device : str, optional
        What it is about (``"NeedleToReference"``); at most 20 bytes.
    stamp : int, default: 0
        When, as :func:`now` says it; 0 where it does not matter.
    metadata : mapping of str to str, optional
        Header version 1 cannot carry it.
    message_id : int, default: 0
        Header version 1 cannot carry it.

    Raises
    ------
    ValueError
        A name that is too long, or numbers beyond their fields.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline import igtl
    >>> message = igtl.Message(igtl.Transform(np.eye(4)), "NeedleToReference", metadata={"TransformStatus": "OK"})
    >>> data = igtl.encode(message, version=2)
    >>> len(data), igtl.decode(data) == message
    (145, True)
    """

    content: Content
    device: str = ""
    stamp: int = 0
    metadata: Mapping[str, str] = field(default_factory=dict)
    message_id: int = 0

    def __post_init__(self) -> None:
        if not isinstance(self.content, Content):
            raise ValueError(f"content = {shown(self.content)} is no content of a message; give a Transform or so")
        encoded_field("device", self.device, 20)
        whole("stamp", self.stamp, MOST_STAMP)
        whole("message_id", self.message_id, (1 << 32) - 1)
        metadata = self.metadata
        if not isinstance(metadata, Mapping) or not all(isinstance(s, str) for item in metadata.items() for s in item):
            raise ValueError(f"metadata = {shown(metadata)} is not texts by names; give them")
        object.__setattr__(self, "metadata", dict(metadata))

    def __repr__(self) -> str:
        return f"Message({shown(self.device)}, {self.content!r})"


def encode(message: Message, version: int = 1) -> bytes:
    """Return a message's bytes.

    Parameters
    ----------
    message : Message
    version : {1, 2, 3}, default: 1
        Of the header: 1 for whoever has not shown that it knows another; it leaves metadata out.

    Raises
    ------
    ValueError
        Another version.
    """
    if version not in VERSIONS:
        raise ValueError(f"version = {shown(version)} is not known; choose one of {', '.join(map(str, VERSIONS))}")
    body = message.content.parts()
    if version > 1:
        body = headers.extended(body, message.metadata, message.message_id)
    check = reduce(lambda check, part: crc64(part, check), body, 0)
    size = sum(map(len, body))
    header = Header(version, message.content.type, message.device, message.stamp, size, check)
    return b"".join((header.packed(), *body))


def decode(data: bytes | memoryview, most: int = MOST_BODY) -> Message:
    """Return the message that bytes are, all of them.

    Parameters
    ----------
    data : bytes or memoryview
        Header and body.
    most : int, optional
        Bytes of a body that are taken.

    Raises
    ------
    WireError
        They are none; which class it is of says why.
    """
    header = parse_header(data, most)
    if len(data) != SIZE + header.body_size:
        raise SizeError(f"{header.what} has {SIZE + header.body_size} bytes; {len(data)} were given")
    return decode_body(header, memoryview(data)[SIZE:])


def decode_body(header: Header, body: bytes | memoryview) -> Message:
    """Return the message that a header and its body are.

    Raises
    ------
    WireError
        They are none; which class it is of says why.
    """
    check_version(header)
    if crc64(body) != header.crc:
        raise ChecksumError(f"{header.what} has a body that does not match its check; it was changed on its way")
    content, message_id = memoryview(body), 0
    metadata: dict[str, str] = {}
    if header.version > 1:
        content, metadata, message_id = headers.unextended(content, header.what)
    reader = Reader(content, header.what)
    try:
        found = _content(header.type, reader)
        reader.end()
        return Message(found, header.device, header.stamp, metadata, message_id)
    except WireError:
        raise
    except ValueError as error:  # what a value of its class may not be
        raise ContentError(f"{header.what}: {error}") from None


def _content(type_: str, reader: Reader) -> Content:
    known = CONTENTS.get(type_)
    if known is None:
        return query_of(type_, reader)
    return known.unpacked(reader) if reader.left or known in _LISTS else Nothing(type_)


def crc64(data: bytes | memoryview, before: int = 0) -> int:
    """Return the check of bytes, after others with a check of their own: CRC-64 of ECMA-182."""
    return int(_core.active.crc64(np.frombuffer(data, np.uint8), before)) if len(data) else before

"""The 58 bytes in front of every body, and what version 2 adds around it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from .errors import SizeError, TooLargeError, UnknownVersionError
from .texts import decoded, encoded
from .wire import Reader, field, layout, text_of, whole

SIZE = 58
VERSIONS = (1, 2, 3)
"""Versions of headers that are read: 1 of the protocols 1 and 2, 2 of protocol 3. 3 has not been defined: it is read as
the C++ library does, as 2."""
MOST_BODY = 1 << 26
"""Bytes of a body that are taken unless another number is given: 64 MiB."""
_LAYOUT, _EXTENDED = "H12s20sQQQ", "HHII"
_EXTENDED_SIZE = 12
_TYPE, _DEVICE = 12, 20


class Header(NamedTuple):
    """What the header of a message says."""

    version: int
    type: str
    device: str
    stamp: int
    body_size: int
    crc: int

    def packed(self) -> bytes:
        """Return its bytes."""
        return layout(_LAYOUT).pack(
            self.version, field("type", self.type, _TYPE), field("device", self.device, _DEVICE), self.stamp,
            self.body_size, self.crc,
        )  # fmt: skip

    @property
    def what(self) -> str:
        """What errors call its message."""
        type_ = self.type if self.type.isprintable() else repr(self.type)
        return f"{type_ or 'a message without a type'} {self.device!r}"


def parse_header(data: bytes | memoryview, most: int = MOST_BODY) -> Header:
    """Return what 58 bytes say.

    Parameters
    ----------
    data : bytes or memoryview
    most : int, optional
        Bytes of a body that are taken.

    Raises
    ------
    SizeError
        Fewer bytes.
    TooLargeError
        The body is larger than ``most``.
    """
    if len(data) < SIZE:
        raise SizeError(f"a header has {SIZE} bytes; {len(data)} were given")
    version, type_, device, stamp, size, crc = layout(_LAYOUT).unpack(data[:SIZE])
    header = Header(version, text_of(type_), text_of(device), stamp, size, crc)
    if size > most:
        raise TooLargeError(f"{header.what} announces {size} bytes; at most {most} are taken")
    return header


def check_version(header: Header) -> None:
    """Raise UnknownVersionError for a header of none that is known."""
    if header.version not in VERSIONS:
        known = ", ".join(map(str, VERSIONS))
        raise UnknownVersionError(f"{header.what} has a header of version {header.version}; known are {known}")


Parts = tuple[bytes | memoryview, ...]
"""Bytes in one piece after the other."""


def extended(content: Parts, metadata: Mapping[str, str], message_id: int) -> Parts:
    """Return a body as version 2 has it: the content between an extended header and metadata."""
    heads, texts = [layout("H").pack(whole("entries of metadata", len(metadata), _MOST_ENTRIES))], []
    for key, value in metadata.items():
        name, (encoding, text) = key.encode(errors="replace"), encoded(value)
        heads.append(layout("HHI").pack(whole("bytes of a key", len(name), 0xFFFF), encoding, len(text)))
        texts.append(name + text)
    front, back = b"".join(heads), b"".join(texts)
    return (layout(_EXTENDED).pack(_EXTENDED_SIZE, len(front), len(back), message_id), *content, front, back)


_MOST_ENTRIES = 8191
"""So that their heads fit into what the extended header can count."""


def unextended(body: memoryview, what: str) -> tuple[memoryview, dict[str, str], int]:
    """Return content, metadata and number of a message from its body as version 2 has it."""
    size, heads, texts, message_id = Reader(body, what).fields(_EXTENDED)
    if not _EXTENDED_SIZE <= size <= len(body) - heads - texts:
        raise SizeError(
            f"{what} has {len(body)} bytes; its extended header says {size} of its own, {heads + texts} of metadata"
        )
    end = len(body) - heads - texts
    return body[size:end], _metadata(body[end : end + heads], body[end + heads :], what), message_id


def _metadata(heads: memoryview, texts: memoryview, what: str) -> dict[str, str]:
    if not heads:
        return {}
    head, text = Reader(heads, f"metadata of {what}"), Reader(texts, f"metadata of {what}")
    found = {}
    for _ in range(head.fields("H")[0]):
        key, encoding, value = head.fields("HHI")
        name = text_of(text.bytes(key))
        found[name] = decoded(head.what, encoding, text.bytes(value))
    return found

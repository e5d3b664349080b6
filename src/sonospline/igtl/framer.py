"""Where one message of a stream ends and the next begins."""

from __future__ import annotations

from .header import MOST_BODY, SIZE, Header, parse_header


class Framer:
    """Parts a stream of bytes into messages. It holds what came, and never more than one message and one chunk.

    Parameters
    ----------
    most : int, optional
        Bytes of a body that are taken.

    Examples
    --------
    >>> from sonospline import igtl
    >>> framer, data = igtl.Framer(), igtl.encode(igtl.Message(igtl.String("hello"), "greeting"))
    >>> framer.feed(data[:60])
    >>> framer.next() is None
    True
    >>> framer.feed(data[60:])
    >>> header, body = framer.next()
    >>> header.device, igtl.decode_body(header, body).content
    ('greeting', String('hello'))
    """

    def __init__(self, most: int = MOST_BODY) -> None:
        self._most, self._held = most, bytearray()
        self._header: Header | None = None

    def feed(self, data: bytes) -> None:
        """Take the next bytes of the stream."""
        self._held += data

    @property
    def within(self) -> bool:
        """Whether the stream is within a message."""
        return bool(self._held) or self._header is not None

    @property
    def announced(self) -> int:
        """Bytes of the body that is waited for; 0 while its header is not whole."""
        return 0 if self._header is None else self._header.body_size

    def next(self) -> tuple[Header, bytes] | None:
        """Return the next message's header and body; None where it is not whole yet.

        Raises
        ------
        TooLargeError
            A body is larger than is taken: the stream cannot be followed any further.
        """
        if self._header is None:
            if len(self._held) < SIZE:
                return None
            self._header = parse_header(self._take(SIZE), self._most)
        if len(self._held) < self._header.body_size:
            return None
        header, self._header = self._header, None
        return header, self._take(header.body_size)

    def _take(self, count: int) -> bytes:
        taken = bytes(memoryview(self._held)[:count])
        del self._held[:count]
        return taken

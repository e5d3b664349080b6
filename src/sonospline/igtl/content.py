"""What every content of a message offers."""

from __future__ import annotations

from typing import ClassVar, Self

from .._by_value import ByValue
from .wire import Reader


class Content(ByValue):
    """What a message is about: a small value that knows its bytes. Its numbers are those that the wire carries."""

    TYPE: ClassVar[str]

    @property
    def type(self) -> str:
        """The type of its messages, as headers have it."""
        return self.TYPE

    def packed(self) -> bytes:
        """Return its bytes."""
        raise NotImplementedError

    def parts(self) -> tuple[bytes | memoryview, ...]:
        """Return its bytes in one piece after the other: what is large need not be copied to be put behind a header."""
        return (self.packed(),)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold.

        Raises
        ------
        WireError
            They are too few or too many, or hold values that are none.
        """
        raise NotImplementedError

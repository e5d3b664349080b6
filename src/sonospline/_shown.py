"""Values as errors show them."""

from __future__ import annotations

import math
from reprlib import Repr
from typing import Any

_LONGEST = 60


def shown(value: Any) -> str:
    """Return a value in one line, not too long, whatever it is.

    Examples
    --------
    >>> from sonospline._shown import shown
    >>> shown([1, "two"]), shown(10**400)
    ("[1, 'two']", '(a whole number of 401 digits)')
    """
    text = _texts.repr(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


class _Texts(Repr):
    """Python's own bounded texts, but for numbers too long to be written at all."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 3, _LONGEST, _LONGEST

    def repr_int(self, value: int, level: int) -> str:
        bits = value.bit_length()
        return repr(value) if bits < 64 else f"(a whole number of {int(bits * math.log10(2)) + 1} digits)"


_texts = _Texts()

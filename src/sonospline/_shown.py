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


def figure(value: float) -> str:
    """Return a number as short as it can be told from its neighbours: 400.0001 is not 400."""
    if isinstance(value, int):
        return shown(value)
    return short if float(short := f"{value:g}") == value else repr(float(value))


def inside(low: float, high: float, *, slack: float = 0.0) -> tuple[str, str]:
    """Return the ends of a range to six figures, each within it or at most ``slack`` beyond: whoever takes one may."""
    return _rounded(low, slack, up=True), _rounded(high, slack, up=False)


def _rounded(value: float, slack: float, *, up: bool) -> str:
    if value == 0 or not math.isfinite(value) or abs(float(f"{value:g}") - value) <= slack:
        return f"{value:g}"
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 5)
    return f"{(math.ceil if up else math.floor)(value / unit) * unit:g}"


class _Texts(Repr):
    """Python's own bounded texts, but for numbers too long to be written at all."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 3, _LONGEST, _LONGEST

    def repr_int(self, value: int, level: int) -> str:
        bits = value.bit_length()
        return repr(value) if bits < 64 else f"(a whole number of {int(bits * math.log10(2)) + 1} digits)"


_texts = _Texts()

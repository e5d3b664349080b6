"""Values as errors show them."""

from __future__ import annotations

import math
from collections.abc import Iterable
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
    text = " ".join(_texts.repr(value).split())
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def figure(value: float) -> str:
    """Return a number as short as it differs from its neighbours: 400.0001 is not 400."""
    if isinstance(value, int):
        return shown(value)
    return short if float(short := f"{value:g}") == value else repr(float(value))


def size(shape: Iterable[int]) -> str:
    """Return the shape of an array as people read it.

    Examples
    --------
    >>> from sonospline._shown import lengths, size
    >>> size((64, 64, 40)), lengths((2, 2, 2)), lengths((0.5, 0.5, 1))
    ('64 x 64 x 40', '2.0 mm', '0.5 x 0.5 x 1.0 mm')
    """
    return " x ".join(map(str, shape))


def lengths(values: Iterable[float]) -> str:
    """Return distances along the axes, mm: one where they are the same to four figures."""
    texts = [str(float(f"{value:.4g}")) for value in values]
    return f"{texts[0] if len(set(texts)) == 1 else ' x '.join(texts)} mm"


def place(point: Iterable[float]) -> str:
    """Return coordinates to five figures, in one short bracket."""
    return "(" + ", ".join(f"{value:.5g}" for value in point) + ")"


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

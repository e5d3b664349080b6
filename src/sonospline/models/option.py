"""One option of a model: its name, unit and range, checked where it is given."""

from __future__ import annotations

from dataclasses import dataclass
from keyword import iskeyword
from typing import Any, Literal

from .. import _validate
from .._shown import figure, shown

_TAKEN = ("name", "tissue", "materials", "needs", "progress", "use", "poissons_ratio")
"""Arguments of :func:`~sonospline.models.make`, and keys of a scene file beside the options."""


@dataclass(frozen=True, kw_only=True)
class Option:
    """An option that a registered model takes.

    Parameters
    ----------
    name : str
        As the model's maker takes it.
    help : str
        One short line.
    kind : {"number", "whole", "choice"}
        A finite number, a whole one, or one of ``choices``.
    default : object
        Its value where none is given; None leaves it to the model.
    unit : str, default: ""
        ``"mm"``, ``"kPa"``; empty for a bare number.
    low, high : float, optional
        Range, ends included.
    choices : tuple of str
        What a choice is one of; words that a number may be instead.
    live : (float, float), optional
        The narrower range of scene files, which strangers may send; they cannot give an option that has none.

    Raises
    ------
    ValueError
        A name that is no word, an unknown kind, or a default out of range.

    Examples
    --------
    >>> from sonospline.models import Option
    >>> drag = Option(name="drag", kind="number", default=None, unit="mm", low=0, high=50, help="at the shaft")
    >>> drag.check(2)
    2.0
    >>> drag.check(80)
    Traceback (most recent call last):
    ValueError: drag = 80 is out of range; give a number from 0 to 50 mm
    """

    name: str
    help: str
    kind: Literal["number", "whole", "choice"] = "number"
    default: Any = None
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise ValueError(f"name = {shown(self.name)} is not a word; give letters, digits and _")
        if self.name in _TAKEN or iskeyword(self.name):
            raise ValueError(f"name = {self.name!r} means something else where options are given; choose another")
        _validate.choice("kind", self.kind, ("number", "whole", "choice"))
        if self.default is not None:
            self.check(self.default, name=f"default of {self.name}")

    def check(self, value: Any, *, name: str | None = None) -> Any:
        """Return a value that the model may be given; ``name`` is what errors call the option.

        Raises
        ------
        ValueError
            Not of the kind, or out of range.
        """
        name = name or self.name
        if value is None and self.default is None:
            return None
        if isinstance(value, str) and value in self.choices:
            return value
        if self.kind == "choice":
            raise ValueError(f"{name} = {shown(value)} is not known; choose one of {', '.join(self.choices)}")
        return self._in_range(name, self._number(name, value))

    def read(self, text: str, *, name: str | None = None) -> Any:
        """Return the value that a text, as of a command line, stands for."""
        number = {"whole": int, "number": float}.get(self.kind)
        if number is None or text in self.choices:
            return self.check(text, name=name)
        try:
            value = number(text)
        except ValueError:
            raise ValueError(f"{name or self.name} = {shown(text)} is not a number; {self._remedy}") from None
        return self.check(value, name=name)

    def _number(self, name: str, value: Any) -> float | int:
        if self.kind == "number":
            return _validate.real(name, value)
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise ValueError(f"{name} = {shown(value)} is not a whole number; {self._remedy}")
        return int(value)

    def _in_range(self, name: str, value: float) -> float:
        beyond = (self.low is not None and value < self.low) or (self.high is not None and value > self.high)
        if beyond:
            raise ValueError(f"{name} = {figure(value)} is out of range; {self._remedy}")
        return value

    @property
    def _remedy(self) -> str:
        what = "a whole number" if self.kind == "whole" else "a number"
        low = "" if self.low is None else f" from {figure(self.low)}"
        high = "" if self.high is None else f" to {figure(self.high)}"
        words = "".join(f", or {word}" for word in self.choices)
        return f"give {what}{low}{high}{self.unit and f' {self.unit}'}{words}"

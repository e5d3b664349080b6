"""Tables from outside, such as TOML and JSON, read as msgspec structs; what is refused is said in one line."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta, Struct

from .._shown import figure, shown

T = TypeVar("T")

LONGEST_TEXT, LONGEST_LIST = 1000, 64
Text = Annotated[str, Meta(max_length=LONGEST_TEXT)]
"""A text of ordinary length."""


class Record(Struct, frozen=True, forbid_unknown_fields=True):
    """A table of known keys."""


def about(help: str, low: float | None = None, high: float | None = None, *, longest: int | None = None) -> Meta:
    """Return what is to be known of a key: what it is, its range, and how long its text or list may be."""
    return Meta(description=help, max_length=longest) if longest else Meta(description=help, ge=low, le=high)


_PLAIN_KEY = re.compile(r"[\w-]{1,40}", re.ASCII)
_PLACE = re.compile(r" - at `\$((?:\.\w+|\[\d+\])*)`\Z")
_STEP = re.compile(r"\.(\w+)|\[(\d+)\]")

Path = tuple[str | int, ...]


class FieldError(ValueError):
    """One value that cannot be used; knows the way to it."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path, self.problem = path, problem
        super().__init__(f"{dotted(path)} {problem}" if path else problem)


def dotted(path: Path) -> str:
    """Return the way to a value as it is written: ``targets[1].at``."""
    text = ""
    for step in path:
        key = step if isinstance(step, str) and _PLAIN_KEY.fullmatch(step) else shown(step)
        text += f"[{step}]" if isinstance(step, int) else f".{key}" if text else key
    return text


def read(kind: type[T], values: Any) -> T:
    """Return a struct made of a table.

    Raises
    ------
    FieldError
        A key that is unknown or missing, or a value of the wrong type or out of range.

    Examples
    --------
    >>> from typing import Annotated
    >>> from sonospline.io.records import Record, about, read
    >>> class Gel(Record):
    ...     stiffness_kpa: Annotated[float, about("Young's modulus", 0)]
    >>> read(Gel, {"stiffness_kpa": 10})
    Gel(stiffness_kpa=10.0)
    >>> read(Gel, {"stiffness_kpa": "soft"})
    Traceback (most recent call last):
        ...
    sonospline.io.records.FieldError: stiffness_kpa = 'soft' is not a number; give a number of at least 0
    """
    try:
        made = msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise _explained(kind, values, error) from None
    except UnicodeEncodeError:
        _check_plain(values)
        raise
    _check_plain(values)
    return made


def schema(kind: Any) -> dict[str, Any]:
    """Return the JSON schema of a struct; those it is made of are in ``$defs``."""
    found = msgspec.json.schema(kind)
    parts = found.pop("$defs")
    return {**parts.pop(kind.__name__), "$defs": parts}


def _explained(kind: Any, values: Any, error: msgspec.ValidationError) -> FieldError:
    """Say in the house's words what msgspec refused."""
    path, value, about = _followed(kind, values, _path_of(str(error)))
    cause = error.__cause__
    if isinstance(cause, FieldError):
        return FieldError((*path, *cause.path), cause.problem)
    if isinstance(about, msgspec.inspect.StructType) and isinstance(value, Mapping):
        return _key_problem(path, value, about)
    return FieldError(path, _problem(value, about))


def _path_of(message: str) -> Path:
    found = _PLACE.search(message)
    steps = _STEP.findall(found[1]) if found else ()
    return tuple(name or int(number) for name, number in steps)


def _followed(kind: Any, values: Any, path: Path) -> tuple[Path, Any, msgspec.inspect.Type]:
    """The way to a value as far as there is one, the value, and what it should be."""
    about, taken = _type_of(kind), 0
    for step in path:
        if isinstance(about, msgspec.inspect.StructType) and isinstance(values, Mapping) and step in values:
            known = {field.encode_name: field.type for field in about.fields}
            if step not in known:
                break
            about, values = _plain(known[str(step)]), values[step]
        elif isinstance(step, int) and isinstance(values, list | tuple) and step < len(values):
            items = about.item_types if isinstance(about, msgspec.inspect.TupleType) else None
            item = items[step] if items else getattr(about, "item_type", None)
            if item is None:
                break
            about, values = _plain(item), values[step]
        else:
            break
        taken += 1
    return path[:taken], values, about


@lru_cache(maxsize=64)
def _type_of(kind: Any) -> msgspec.inspect.Type:
    return _plain(msgspec.inspect.type_info(kind))


def _plain(about: msgspec.inspect.Type) -> msgspec.inspect.Type:
    """A type without what is said of it, and without None."""
    if isinstance(about, msgspec.inspect.Metadata):
        return _plain(about.type)
    if isinstance(about, msgspec.inspect.UnionType):
        return _plain(next(one for one in about.types if not isinstance(one, msgspec.inspect.NoneType)))
    return about


def _key_problem(path: Path, values: Mapping[str, Any], about: msgspec.inspect.StructType) -> FieldError:
    names = [field.encode_name for field in about.fields]
    for key in values:
        if key not in names and key != about.tag_field:
            return FieldError((*path, key), f"is not known; use {', '.join(names) or 'no key'}")
    for field in about.fields:
        if field.required and field.encode_name not in values:
            return FieldError((*path, field.encode_name), f"is missing; give {_wanted(_plain(field.type))}")
    return FieldError(path, f"= {shown(values)} cannot be used")


def _problem(value: Any, about: msgspec.inspect.Type) -> str:
    wanted = _wanted(about)
    match about:
        case msgspec.inspect.StructType():
            return f"= {shown(value)} is not a table; give {', '.join(field.encode_name for field in about.fields)}"
        case msgspec.inspect.LiteralType():
            return f"= {shown(value)} is not known; choose {wanted}"
        case msgspec.inspect.FloatType() | msgspec.inspect.IntType():
            return _number_problem(value, about, wanted)
        case msgspec.inspect.StrType() if isinstance(value, str):
            return f"has {len(value)} characters; give at most {about.max_length}"
        case msgspec.inspect.VarTupleType() | msgspec.inspect.ListType() if isinstance(value, list | tuple):
            return f"has {len(value)} entries; give at most {about.max_length}"
    return f"= {shown(value)} is of the wrong kind; give {wanted}"


def _number_problem(value: Any, about: msgspec.inspect.FloatType | msgspec.inspect.IntType, wanted: str) -> str:
    real = isinstance(about, msgspec.inspect.FloatType)
    if isinstance(value, bool) or not isinstance(value, (int, float) if real else int):
        return f"= {shown(value)} is {'not a number' if real else 'of the wrong kind'}; give {wanted}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"= {value} is not finite; give {wanted}"
    return f"= {figure(value)} is out of range; give {wanted}"


def _wanted(about: msgspec.inspect.Type) -> str:
    match about:
        case msgspec.inspect.StructType():
            return f"a table of {', '.join(field.encode_name for field in about.fields)}"
        case msgspec.inspect.LiteralType():
            return f"one of {', '.join(map(str, about.values))}"
        case msgspec.inspect.FloatType():
            return "a number" + _range(about.ge, about.le)
        case msgspec.inspect.IntType():
            return "a whole number" + _range(about.ge, about.le)
        case msgspec.inspect.StrType():
            return "a text"
        case msgspec.inspect.BoolType():
            return "true or false"
        case msgspec.inspect.TupleType():
            return f"{len(about.item_types)} values in a list"
    return "a list"


def _range(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f" from {low:g} to {high:g}"
    return f" of at least {low:g}" if low is not None else ""


def _check_plain(values: Any) -> None:
    """Refuse what a type does not: numbers that are not finite, and halves of characters."""
    waiting: list[tuple[Path, Any]] = [((), values)]
    while waiting:
        path, value = waiting.pop()
        match value:
            case Mapping():
                waiting += [((*path, key), part) for key, part in value.items()]
                _check_text(path, "".join(value))
            case list() | tuple():
                waiting += [((*path, k), part) for k, part in enumerate(value)]
            case float() if not math.isfinite(value):
                raise FieldError(path, f"= {value} is not finite; give a number")
            case str():
                _check_text(path, value)


def _check_text(path: Path, text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise FieldError(path, "holds half a character (a lone surrogate); give a text") from None

"""Reading dataclasses from the outside: TOML tables and JSON messages, checked, with a JSON schema."""

from __future__ import annotations

import math
import re
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from functools import lru_cache
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from .._shown import figure, shown

T = TypeVar("T")

_LONGEST_TEXT = 1000
_LONGEST_LIST = 64
_PLAIN_KEY = re.compile(r"[\w-]{1,40}", re.ASCII)


class FieldError(ValueError):
    """One value that cannot be used; knows the way to it."""

    def __init__(self, path: tuple[str | int, ...], problem: str) -> None:
        self.path = path
        super().__init__(f"{dotted(path)} {problem}" if path else problem)


def told(
    help: str, *, low: float | None = None, high: float | None = None, longest: int = _LONGEST_TEXT, **default: Any
) -> Any:
    """Return a dataclass field that says what it is, what range it has, and how long a text may be."""
    return field(metadata={"help": help, "low": low, "high": high, "longest": longest}, **default)


def dotted(path: tuple[str | int, ...]) -> str:
    """Return the way to a value as it is written: ``targets[1].at``."""
    text = ""
    for step in path:
        key = step if isinstance(step, str) and _PLAIN_KEY.fullmatch(step) else shown(step)
        text += f"[{step}]" if isinstance(step, int) else f".{key}" if text else key
    return text


def read(kind: type[T], values: Any, path: tuple[str | int, ...] = ()) -> T:
    """Return a dataclass made of a mapping.

    Raises
    ------
    FieldError
        A key that is unknown or missing, or a value of the wrong type or out of range.
    """
    if not isinstance(values, Mapping):
        raise FieldError(path, f"= {shown(values)} is not a table; give {', '.join(_names(kind))}")
    for key in values:
        if key not in _names(kind):
            raise FieldError((*path, key), f"is not known; use {', '.join(_names(kind))}")
    hints, found = _hints(kind), {}
    for entry in fields(kind):  # type: ignore[arg-type]
        here = (*path, entry.name)
        if entry.name in values:
            found[entry.name] = _value(hints[entry.name], values[entry.name], here, entry)
        elif entry.default is MISSING and entry.default_factory is MISSING:
            raise FieldError(here, f"is missing; give {_wanted(hints[entry.name], entry)}")
    try:
        return kind(**found)
    except FieldError as error:
        raise FieldError((*path, *error.path), str(error).removeprefix(dotted(error.path)).lstrip()) from None


def schema(kind: Any) -> dict[str, Any]:
    """Return the JSON schema of a dataclass."""
    hints = _hints(kind)
    properties, required = {}, []
    for entry in fields(kind):
        about = _schema_of(hints[entry.name], entry)
        if "help" in entry.metadata:
            about["description"] = entry.metadata["help"]
        if entry.default is MISSING and entry.default_factory is MISSING:
            required.append(entry.name)
        elif entry.default is not MISSING and not is_dataclass(entry.default):
            about["default"] = entry.default
        properties[entry.name] = about
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


# Looked up for every message: a state message has five tables.
_hints: Callable[[Any], dict[str, Any]] = lru_cache(maxsize=64)(get_type_hints)
_names: Callable[[Any], tuple[str, ...]] = lru_cache(maxsize=64)(
    lambda kind: tuple(entry.name for entry in fields(kind))
)


def _value(hint: Any, value: Any, path: tuple[str | int, ...], entry: Field[Any]) -> Any:
    hint = _without_none(hint)
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            raise FieldError(
                path, f"= {shown(value)} is not known; choose one of {', '.join(map(str, get_args(hint)))}"
            )
        return value
    if get_origin(hint) is tuple:
        return _sequence(get_args(hint), value, path, entry)
    if is_dataclass(hint):
        return read(hint, value, path)  # type: ignore[arg-type]
    if hint is float:
        return _number(value, path, entry)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise FieldError(path, f"= {shown(value)} is of the wrong kind; give {_wanted(hint, entry)}")
    if hint is int:
        _check_range(value, int, path, entry)
    if hint is str:
        _check_text(value, path, entry)
    return value


def _check_text(value: str, path: tuple[str | int, ...], entry: Field[Any]) -> None:
    longest = entry.metadata.get("longest", _LONGEST_TEXT)
    if len(value) > longest:
        raise FieldError(path, f"has {len(value)} characters; give at most {longest}")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise FieldError(path, "holds half a character (a lone surrogate); give a text") from None


def _sequence(items: tuple[Any, ...], value: Any, path: tuple[str | int, ...], entry: Field[Any]) -> Any:
    many = items[-1] is Ellipsis
    if not isinstance(value, list | tuple) or (not many and len(value) != len(items)):
        wanted = "a list" if many else f"{len(items)} values in a list"
        raise FieldError(path, f"= {shown(value)} is of the wrong kind; give {wanted}")
    if len(value) > _LONGEST_LIST:
        raise FieldError(path, f"has {len(value)} entries; give at most {_LONGEST_LIST}")
    kinds = [items[0]] * len(value) if many else items
    return tuple(_value(kind, item, (*path, k), entry) for k, (kind, item) in enumerate(zip(kinds, value, strict=True)))


def _number(value: Any, path: tuple[str | int, ...], entry: Field[Any]) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FieldError(path, f"= {shown(value)} is not a number; give {_wanted(float, entry)}")
    if isinstance(value, float) and not math.isfinite(value):
        raise FieldError(path, f"= {value} is not finite; give {_wanted(float, entry)}")
    _check_range(value, float, path, entry)
    try:
        return float(value)
    except OverflowError:
        raise FieldError(path, f"= {shown(value)} is too large; give {_wanted(float, entry)}") from None


def _check_range(value: float, kind: type, path: tuple[str | int, ...], entry: Field[Any]) -> None:
    low, high = entry.metadata.get("low"), entry.metadata.get("high")
    if (low is not None and value < low) or (high is not None and value > high):
        raise FieldError(path, f"= {figure(value)} is out of range; give {_wanted(kind, entry)}")


def _wanted(hint: Any, entry: Field[Any]) -> str:
    hint = _without_none(hint)
    if is_dataclass(hint):
        return f"a table of {', '.join(_names(hint))}"
    if get_origin(hint) is Literal:
        return f"one of {', '.join(map(str, get_args(hint)))}"
    name = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}.get(hint, "a list")
    low, high = entry.metadata.get("low"), entry.metadata.get("high")
    if low is not None and high is not None:
        return f"{name} from {low:g} to {high:g}"
    return f"{name} of at least {low:g}" if low is not None else name


def _schema_of(hint: Any, entry: Field[Any]) -> dict[str, Any]:
    hint = _without_none(hint)
    if get_origin(hint) is Literal:
        return {"enum": list(get_args(hint))}
    if get_origin(hint) is tuple:
        items = get_args(hint)
        about: dict[str, Any] = {"type": "array", "items": _schema_of(items[0], entry)}
        if items[-1] is not Ellipsis:
            about |= {"minItems": len(items), "maxItems": len(items)}
        return about
    if is_dataclass(hint):
        return schema(hint)
    about = {"type": {float: "number", int: "integer", str: "string", bool: "boolean"}[hint]}
    for key, name in (("low", "minimum"), ("high", "maximum")):
        if hint in (float, int) and entry.metadata.get(key) is not None:
            about[name] = entry.metadata[key]
    return about


def _without_none(hint: Any) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        return next(kind for kind in get_args(hint) if kind is not types.NoneType)
    return hint

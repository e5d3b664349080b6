"""Checks at the border: each says which argument, which value and what would be right."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._shown import shown

Array = NDArray[np.float64]


def vector(name: str, value: ArrayLike) -> Array:
    """Return three finite numbers as a read-only array of their own."""
    array = _floats(name, value).copy()
    if array.shape != (3,):
        raise ValueError(f"{name} = {shown(value)} has shape {array.shape}; give three numbers x, y, z")
    array.setflags(write=False)
    return _finite(name, array)


def points(name: str, value: ArrayLike) -> Array:
    """Return finite points as a C-ordered (m, 3) array."""
    array = _floats(name, value)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} has shape {array.shape}; give an (m, 3) array of x, y, z rows")
    return _finite(name, array)


def rows(name: str, value: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Return finite points as a C-ordered (m, 3) array, and the shape of their answers.

    One point has answers of shape (), m points of shape (m,), and points in any other array
    (..., 3) answers of its leading shape.
    """
    array = _floats(name, value)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"{name} has shape {array.shape}; give an (m, 3) array of x, y, z rows, or one point")
    return _finite(name, array).reshape(-1, 3), array.shape[:-1]


def number(name: str, value: float, *, positive: bool = False) -> float:
    """Return a finite number at or above zero (above zero where ``positive``)."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {shown(value)} is not a number; give one") from None
    except OverflowError:
        raise ValueError(f"{name} = {shown(value)} is too large; give a finite number") from None
    wanted = "above zero" if positive else "at or above zero"
    if not np.isfinite(result) or result < 0 or (positive and result == 0):
        raise ValueError(f"{name} = {value} is out of range; give a finite number {wanted}")
    return result


def real(name: str, value: float) -> float:
    """Return a finite number of either sign."""
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {shown(value)} is not a number; give one") from None
    if not np.isfinite(result):
        raise ValueError(f"{name} = {value} is not finite; give a finite number")
    return result


def count(name: str, value: int, *, least: int = 1, most: int | None = None) -> int:
    """Return a whole number of at least ``least``, and at most ``most`` where that is given."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise ValueError(f"{name} = {shown(value)} is not a whole number; give an integer of at least {least}")
    if value < least:
        raise ValueError(f"{name} = {shown(int(value))} is too small; give at least {least}")
    if most is not None and value > most:
        raise ValueError(f"{name} = {shown(int(value))} is too large; give at most {most}")
    return int(value)


def flag(name: str, value: bool) -> bool:
    """Return ``value`` where it is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} = {shown(value)} is neither true nor false; give one of them")
    return bool(value)


def text(name: str, value: str) -> str:
    """Return ``value`` where it is a text."""
    if not isinstance(value, str):
        raise ValueError(f"{name} = {shown(value)} is not a text; give one")
    return value


def choice(name: str, value: str, allowed: Iterable[str]) -> str:
    """Return ``value`` where it is one of ``allowed``."""
    options = tuple(allowed)
    if value not in options:
        raise ValueError(f"{name} = {shown(value)} is not known; choose one of {', '.join(options)}")
    return value


def _floats(name: str, value: ArrayLike) -> Array:
    try:
        return np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {shown(value)} is not numeric; give numbers") from None


def _finite(name: str, array: Array) -> Array:
    if not np.isfinite(array).all():
        bad = array.reshape(-1, 3)[~np.isfinite(array.reshape(-1, 3)).all(axis=1)][0]
        raise ValueError(f"{name} contains NaN or infinity (first at {bad.tolist()}); give finite numbers")
    return array

"""Value objects: equal where their fields are, arrays among them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

_HASHED = 16
"""Numbers of an array that a hash looks at: those of poses and points whole, of voxels none."""


class ByValue:
    """A dataclass that compares by value: arrays by their shapes and numbers, NaN equal to NaN.

    Numbers that are equal are the same, whatever their types and the sign of zero; hashes agree.
    """

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(other) is not type(self):
            return NotImplemented
        return all(_same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self))  # type: ignore[arg-type]

    def __hash__(self) -> int:
        return hash((type(self), *(_key(getattr(self, field.name)) for field in fields(self))))  # type: ignore[arg-type]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        if one is other:
            return True
        return np.array_equal(one, other) or (_may_be_nan(one, other) and np.array_equal(one, other, equal_nan=True))
    return bool(one == other)


def _may_be_nan(*arrays: Any) -> bool:
    return all(np.asarray(array).dtype.kind in "fc" for array in arrays)


def _key(value: Any) -> Hashable:
    """What equal values share, and as many others as may be do not."""
    if isinstance(value, np.ndarray):
        few = value.ravel().tolist() if value.size <= _HASHED else ()
        return (value.shape, *(None if number != number else number for number in few))
    if isinstance(value, Mapping):
        return frozenset((key, _key(item)) for key, item in value.items())
    if isinstance(value, list | tuple):
        return tuple(map(_key, value))
    return value if isinstance(value, Hashable) else type(value).__name__

"""A short text for values that are equal bit for bit: what states and kept results are known by."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def digest(*values: Any) -> str:
    """Return a short text that two tuples of values share where they are equal bit for bit.

    Examples
    --------
    >>> from sonospline._digest import digest
    >>> digest(1.0, [2, 3]) == digest(1.0, [2, 3]), digest(0.0) == digest(-0.0)
    (True, False)
    """
    found = hashlib.blake2b(digest_size=16)
    for part in _parts(values):
        found.update(part)
    return found.hexdigest()


def digest_of_bytes(content: bytes) -> str:
    """Return a short text that two files of the same bytes share."""
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """The bytes of a value, each piece with its length so that no two values share them."""
    if isinstance(value, np.ndarray):
        yield f"array {value.dtype.str} {value.shape} ".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)} ".encode()
        for pair in value.items():
            yield from _parts(pair)
    elif isinstance(value, tuple | list):
        yield f"list {len(value)} ".encode()
        for item in value:
            yield from _parts(item)
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__qualname__} ".encode()
        yield from _parts([(field.name, getattr(value, field.name)) for field in fields(value)])
    elif value is None or isinstance(value, bool | int | float | str | np.generic):
        text = repr(value.item() if isinstance(value, np.generic) else value).encode()
        yield f"{len(text)} ".encode() + text
    else:
        content = pickle.dumps(value, protocol=5)
        yield f"object {len(content)} ".encode() + content

"""Types of numbers, as messages number them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .errors import ContentError

SCALARS: Mapping[int, np.dtype[Any]] = {
    code: np.dtype(name)
    for code, name in {
        2: "int8", 3: "uint8", 4: "int16", 5: "uint16", 6: "int32", 7: "uint32", 10: "float32", 11: "float64",
    }.items()
}  # fmt: skip
"""Of images."""
NUMBERS: Mapping[int, np.dtype[Any]] = {**SCALARS, 13: np.dtype("complex128")}
"""Of arrays."""


def code_of(name: str, kind: np.dtype[Any], known: Mapping[int, np.dtype[Any]]) -> int:
    """Return the number of a type, in whatever byte order; ValueError for one without."""
    for code, dtype in known.items():
        if dtype == kind.newbyteorder("="):
            return code
    raise ValueError(f"{name} are {kind}; give one of {', '.join(map(str, known.values()))}")


def kind_of(what: str, code: int, known: Mapping[int, np.dtype[Any]]) -> np.dtype[Any]:
    """Return the type of a number; ContentError for one without."""
    if code not in known:
        raise ContentError(f"{what} has numbers of type {code}; known are {', '.join(map(str, known))}")
    return known[code]

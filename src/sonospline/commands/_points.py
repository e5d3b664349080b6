"""Points and directions as the command line takes them: ``X,Y,Z``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _validate


def parse(name: str, text: str) -> NDArray[np.float64]:
    """Return three numbers; ValueError naming the option otherwise."""
    try:
        numbers = [float(part) for part in str(text).split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise ValueError(f"--{name} {text!r} is not a point; give three numbers X,Y,Z")
    return _validate.vector(f"--{name}", numbers)

"""Points and directions as the command line takes them: ``X,Y,Z``, or a file of 3D Slicer's markups."""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..io.markups import SUFFIX, place_of


def check(args: argparse.Namespace, *names: str) -> None:
    """Raise ValueError for the first of these options that is given and is no point, used or not."""
    for name in names:
        if getattr(args, name) is not None:
            parse(name, getattr(args, name))


def is_markups(text: str) -> bool:
    """Return whether a point is given as a file of 3D Slicer's markups: it is in RAS then, whatever numbers are in."""
    return str(text).lower().endswith(SUFFIX)


def parse(name: str, text: str) -> NDArray[np.float64]:
    """Return three numbers, or the point of that name in a markups file; ValueError naming the option otherwise."""
    if is_markups(text):
        return place_of(text, name)
    try:
        numbers = [float(part) for part in str(text).split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise ValueError(f"--{name} {text!r} is not a point; give three numbers X,Y,Z")
    return _validate.vector(f"--{name}", numbers)

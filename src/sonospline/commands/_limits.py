"""What a number on the command line may be: said before any work is done, with what would be right."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import NamedTuple

from .. import _memory, _validate


class Whole(NamedTuple):
    """A whole number: its range, and the memory it asks for (``bytes_each`` times its ``power``-th power)."""

    least: int
    most: int
    bytes_each: int = 0
    power: int = 1


class Real(NamedTuple):
    """A finite number and its range, both ends included."""

    least: float
    most: float


Limits = Mapping[str, Whole | Real]

SEED = Whole(0, 2**32 - 1)
STEPS = Whole(1, 100_000)
NODES = Whole(8, 10**10, bytes_each=400)
"""Positions, displacement, its inverse and its Jacobian: 210 bytes a node were measured."""


def check(args: argparse.Namespace, limits: Limits) -> None:
    """Raise ValueError for the first option that is out of its range or asks for more memory than there is."""
    for name, limit in limits.items():
        value, option = getattr(args, name), "--" + name.replace("_", "-")
        if value is None:
            continue
        if isinstance(limit, Whole):
            _validate.count(option, value, least=limit.least, most=limit.most)
            _check_memory(option, value, limit)
        elif not limit.least <= value <= limit.most:
            raise ValueError(f"{option} = {value} is out of range; give {limit.least:g} to {limit.most:g}")


def _check_memory(option: str, value: int, limit: Whole) -> None:
    wanted, free = limit.bytes_each * value**limit.power, _memory.free_bytes(limit.bytes_each * value**limit.power)
    if free is not None and wanted > free:
        most = int((free / limit.bytes_each) ** (1 / limit.power))
        raise ValueError(
            f"{option} = {value} would take about {wanted / 1e9:,.0f} GB, and {free / 1e9:,.1f} can be had; "
            f"give at most {most}"
        )

"""Bone stops a needle: where its tip comes to rest, and what is said of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from .._shown import place
from ..fields.field import Field
from ..geometry.needle import Needle
from .obstacle import Obstacle
from .tissue_map import TissueMap

CLEARANCE_MM = 1e-3
"""From a tip that rests on bone to the bone: the tip is in what lies before it."""


@dataclass(frozen=True)
class Blocked:
    """A needle rests on bone, which it does not enter.

    Parameters
    ----------
    needle : str
        Its name.
    by : str
        Name of the bone, as the label map has it; ``"label 7"`` where it has none.
    depth_mm : float
        How deep the needle is in.

    Examples
    --------
    >>> from sonospline.mechanics import Blocked
    >>> print(Blocked("biopsy", "rib_left_8", 31.25))
    biopsy rests on rib_left_8, 31.2 mm deep
    """

    needle: str
    by: str
    depth_mm: float

    def __str__(self) -> str:
        return f"{self.needle} rests on {self.by}, {self.depth_mm:.1f} mm deep"


class Stopped(NamedTuple):
    """Needles as far as bone lets them in, and an event for each that rests on it."""

    needles: tuple[tuple[str, Needle], ...]
    events: tuple[Blocked, ...]


def stopped(needles: Mapping[str, Needle], tissues: TissueMap | None, field: Field | None = None) -> Stopped:
    """Return needles that end where they meet bone; those that meet none are the same objects.

    Parameters
    ----------
    needles : mapping of str to Needle
        In the world.
    tissues : TissueMap or None
        Whose bone it is.
    field : Field, optional
        How the tissue has moved so far, and loose fragments with it.

    Raises
    ------
    ValueError
        A needle whose entry lies in bone.
    """
    if tissues is None or not tissues.has_bone:
        return Stopped(tuple(needles.items()), ())
    found, events = [], []
    for name, needle in needles.items():
        met = bone_at(needle, tissues, field)
        if met is not None:
            if met.depth_mm < 2 * CLEARANCE_MM:
                raise ValueError(
                    f"entry = {place(needle.entry)} of needle {name!r} lies in bone, {met.name}; enter beside it"
                )
            if needle.depth > met.depth_mm - CLEARANCE_MM / 2:  # one that rests there already stays as it is
                needle = Needle(needle.entry, needle.entry + (met.depth_mm - CLEARANCE_MM) * needle.direction)
            events.append(Blocked(name, met.name, needle.depth))
        found.append((name, needle))
    return Stopped(tuple(found), tuple(events))


def bone_at(needle: Needle, tissues: TissueMap, field: Field | None = None) -> Obstacle | None:
    """Return the bone that a needle meets, or rests on."""
    ahead = needle.tip + 2 * CLEARANCE_MM * needle.direction
    return tissues.obstacle(Needle(needle.entry, ahead), field) if tissues.has_bone else None

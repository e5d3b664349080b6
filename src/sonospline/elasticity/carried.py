"""Needles in tissue that moves anyway, and their displacement carried along by it: on the nodes of one display grid."""

from __future__ import annotations

from collections.abc import Mapping

from ..fields.carried_field import CarriedField
from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from .background import undeformed

Needles = Mapping[str, Needle]


def both(first: GridField | None, second: GridField | None) -> GridField | None:
    """Return the sum of two displacements of undeformed tissue, on the same grid."""
    if first is None or second is None:
        return second if first is None else first
    return GridField(first.grid, first.values + second.values)


def needles_at_rest(background: GridField | None, needles: Needles) -> Needles:
    """Return needles as undeformed tissue has them; those that are where no tissue is are left out."""
    if background is None:
        return needles
    found = {name: undeformed(background, needle) for name, needle in needles.items()}
    return {name: needle for name, needle in found.items() if needle is not None}


def composed(by_needles: GridField, background: GridField | None) -> GridField:
    """Return where tissue is: first the needles' displacement, then the background's."""
    if background is None:
        return by_needles
    if not by_needles.values.any():
        return background
    return GridField(by_needles.grid, CarriedField(by_needles, background).on_grid())

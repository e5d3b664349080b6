"""Membranes: what a tip has to break before it is in a tissue, or out of it again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from .. import _validate
from .._shown import shown

SPEED_MM_S = 5.0
"""At which a rupture force is stated."""
_SLOWEST = 0.1
"""mm/s: a tip that rests is one that creeps on."""


@dataclass(frozen=True)
class Membrane:
    """A thin wall around some tissues: a tip dents it, and breaks through at a force.

    Parameters
    ----------
    name : str
        As events and read-outs have it, such as ``"renal capsule"``.
    around : sequence of str
        Names of the tissues inside it, or patterns of names (``"kidney*"``); ``"*"`` is all of the body, whose
        membrane is the skin.
    rupture_force_n : float
        Force at the tip under which it breaks, N, above zero.
    rate : float, default: 0.0
        Part by which that force grows where the tip is e times as fast: F = F0 (1 + rate ln(v / 5 mm/s)), between a
        half and twice F0. Above -1 and below 1. Tissue that has no time to give way breaks at less: below zero.
    source : str, default: "assumed"
        Where the values come from.

    Raises
    ------
    ValueError
        A value out of range, or of another kind.

    Examples
    --------
    >>> from sonospline.mechanics import Membrane
    >>> capsule = Membrane("renal capsule", around=["kidney*"], rupture_force_n=1.2, rate=-0.1)
    >>> capsule.holds("kidney cortex"), capsule.holds("liver"), round(capsule.rupture_force(50.0), 2)
    (True, False, 0.92)
    """

    name: str
    around: tuple[str, ...]
    rupture_force_n: float
    rate: float = 0.0
    source: str = "assumed"

    def __init__(
        self, name: str, around: Sequence[str], rupture_force_n: float, rate: float = 0.0, source: str = "assumed"
    ) -> None:
        if isinstance(around, str) or not around or not all(isinstance(tissue, str) for tissue in around):
            raise ValueError(
                f'around = {shown(around)} is no list of tissues; give names or patterns, e.g. ["kidney*"]'
            )
        object.__setattr__(self, "name", _validate.text("name", name))
        object.__setattr__(self, "around", tuple(around))
        force = _validate.number("rupture_force_n", rupture_force_n, positive=True)
        object.__setattr__(self, "rupture_force_n", force)
        rate = _validate.real("rate", rate)
        if abs(rate) >= 1:
            raise ValueError(f"rate = {rate:g} is out of range; give one above -1 and below 1")
        object.__setattr__(self, "rate", rate)
        object.__setattr__(self, "source", _validate.text("source", source))

    def holds(self, tissue: str) -> bool:
        """Return whether a tissue is inside the membrane."""
        return any(fnmatchcase(tissue, pattern) for pattern in self.around)

    def rupture_force(self, speed_mm_s: float | None) -> float:
        """Return the force in N at which it breaks under a tip of a speed; None is a tip without time."""
        if speed_mm_s is None:
            return self.rupture_force_n
        grown = 1 + self.rate * np.log(max(speed_mm_s, _SLOWEST) / SPEED_MM_S)
        return self.rupture_force_n * float(np.clip(grown, 0.5, 2.0))

    def __repr__(self) -> str:
        return f"Membrane({self.name!r}, around {len(self.around)} names, {self.rupture_force_n:g} N)"

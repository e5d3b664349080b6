"""The numbers beside the picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Blocked = Literal["end of needle", "leaves the tissue", "needle inside"]
"""Why a needle is not where it was asked to be."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Readouts:
    """The numbers beside the picture, in mm; of the needle that is shown.

    While none is in, a console's are from where it would enter; a session's own that need a tip are NaN.
    """

    tip_to_target: float
    """From the tip to the target where it is now."""
    depth: float
    """Inserted length."""
    moved: float
    """How far the target is from where it was at rest."""
    moved_parts: tuple[float, float, float]
    """Of that: to the right, deeper, away from the viewer."""
    out_of_plane: float
    """Tip out of the image plane along its z, away from the viewer is plus."""
    half_slice: float
    """Half the slice's thickness at the tip: nearer counts as in plane."""
    folds: bool
    """Whether the field turns tissue inside out anywhere near the needle."""
    estimate: float | None
    """Error of the field relative to itself, where the model knows it."""

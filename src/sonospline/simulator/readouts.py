"""The numbers beside the picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:  # the server listens before what computes is loaded
    from ..geometry.needle import Needle
    from ..models.contract import NeedleForce

Blocked = Literal["end of needle", "leaves the tissue", "needle inside", "bone", "held"]
"""Why a needle is not where it was asked to be."""


@dataclass(frozen=True)
class HubForce:
    """What the hand that holds a needle's hub feels of it.

    Parameters
    ----------
    axial_n : float
        Along the needle, N; pushing is plus.
    lateral_n : float
        Across it, N.
    moment_nmm : float
        About its hub, N mm.
    """

    axial_n: float = 0.0
    lateral_n: float = 0.0
    moment_nmm: float = 0.0

    @classmethod
    def of(cls, force: NeedleForce, needle: Needle, length_mm: float) -> HubForce:
        """Return it of a needle as long as that from hub to tip."""
        moment = force.at(-length_mm * needle.direction)
        return cls(force.axial_n, force.lateral_n, float(np.linalg.norm(moment)))

    def __repr__(self) -> str:
        return f"HubForce({self.axial_n:.3g} N, {self.lateral_n:.3g} N across, {self.moment_nmm:.3g} N mm)"


@dataclass(frozen=True, eq=False, kw_only=True)
class Readouts:
    """The numbers beside the picture, in mm where nothing else is said; of the needle that is shown.

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
    """Error of the needles' field relative to itself, where the model knows it."""
    excursion: float
    """Of the diaphragm towards the feet, as somebody breathes."""
    hub: HubForce | None
    """What the hand feels; None where the model knows no forces."""
    probe_n: float | None
    """Force of the probe on the skin, N; None where it only looks."""

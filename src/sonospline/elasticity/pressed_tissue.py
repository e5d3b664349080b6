"""Tissue under a probe, as its pictures have it: the dent, which follows the probe."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from .background import Background, BackgroundMotion

Array = NDArray[np.float64]


class Pressed(NamedTuple):
    """What a probe does."""

    field: GridField | None
    """The displacement, linear between the nodes of the display grid; None where there is none."""
    force_n: float
    """Of the probe on the skin."""


class PressedTissue:
    """The dents of a probe on the display grid.

    Where the tissue is painted with a dent, displacements are from there: what the probe does at its pose, less what it
    does where the phantom has it. At rest nothing moves; elsewhere the dent comes along, and the painted one is gone.

    Parameters
    ----------
    motion : BackgroundMotion
        Of tissue without a dent.
    painted : (4, 4) ndarray, optional
        Pose of the probe that the tissue is painted with.
    """

    def __init__(self, motion: BackgroundMotion, painted: Array | None = None) -> None:
        self._motion = motion
        self._painted = motion.rest if painted is None else motion.at(probe_to_reference=painted)
        self._last: tuple[bytes, Pressed] | None = None

    def at(self, probe_to_reference: Array) -> Pressed:
        """Return what the probe does at a pose (4, 4); that of the last one is kept, for probes are held.

        Raises
        ------
        ValueError
            A probe whose middle is beyond the skin, or that is pressed too deep.
        """
        asked = probe_to_reference.tobytes()
        if self._last is None or self._last[0] != asked:
            now = self._motion.at(probe_to_reference=probe_to_reference)
            self._last = asked, Pressed(self._field(now), now.probe_force_n)
        return self._last[1]

    def _field(self, now: Background) -> GridField | None:
        moved = now.displacement - self._painted.displacement
        return GridField.of(self._motion.field(Background(moved))) if moved.any() else None

    def __repr__(self) -> str:
        return f"PressedTissue({self._motion!r})"

"""One frame of the simulator: the picture and everything that belongs to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..ultrasound.frame import Frame
from .command import Command
from .pass_metrics import PassMetrics
from .readouts import Blocked, Readouts

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Shot:
    """One frame."""

    number: int
    command: Command
    """The state in force, after clamping."""
    blocked: Blocked | None
    """Why the needle is not where it was asked to be."""
    image: Frame
    probe_to_reference: Array
    """(4, 4) pose of the probe, origin in the middle of its face."""
    entry: Array
    tip: Array
    direction: Array
    needle: Needle | None
    """The needle in the tissue; None while it is out."""
    field: GridField
    """The deformation as the picture shows it."""
    target: str
    target_rest: Array
    target_now: Array
    readouts: Readouts
    metrics: PassMetrics
    model: str
    settled: bool
    """Whether the tissue has come to rest: another step at the same pose would change nothing."""
    step_ms: float
    render_ms: float

    @property
    def image_to_reference(self) -> Array:
        """(4, 4) pose of the picture, origin at the centre of pixel (0, 0)."""
        return self.image.plane.image_to_reference

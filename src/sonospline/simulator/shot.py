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

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Readouts:
    """The metrics beside the picture, in mm."""

    tip_to_target: float
    """From the tip to the target where it is now; from the entry while the needle is out."""
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Shot:
    """One frame."""

    number: int
    command: Command
    """The state in force, after clamping."""
    blocked: str | None
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

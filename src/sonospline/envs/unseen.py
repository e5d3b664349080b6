"""A scene without its pictures, for who works on numbers alone: nine tenths of a frame's time are the picture's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..simulator.command import ImageSettings
from ..simulator.imaging import Imager
from ..simulator.scene import Scene
from ..ultrasound.frame import Frame
from ..ultrasound.optics import picture_plane
from ..ultrasound.probe import Probe

Array = NDArray[np.float64]

_PIXELS = 2
"""Along the longer side of a picture that nobody looks at."""


class BlackImager(Imager):
    """Makes the same small black picture whatever there is to see."""

    def __init__(self, probe: Probe, probe_to_reference: Array) -> None:
        self.probe, self.probe_to_reference = probe, probe_to_reference
        plane = picture_plane(probe, probe_to_reference, (_PIXELS, _PIXELS))
        self._frame = Frame(np.zeros(plane.shape, np.uint8), plane, np.zeros(plane.shape, bool))

    def aimed(self, probe: Probe, probe_to_reference: Array) -> BlackImager:
        return BlackImager(probe, probe_to_reference)

    def render(
        self, field: GridField, needle: Needle | None, *, frame: int, settings: ImageSettings, time_s: float = 0.0
    ) -> Frame:
        return self._frame


def without_pictures(scene: Scene) -> Scene:
    """Return a scene in which everything happens as in another, and no picture shows it."""
    return replace(scene, see=BlackImager)

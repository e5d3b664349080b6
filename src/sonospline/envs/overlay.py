"""The picture people look at: B-mode with the target and the needle's axis drawn on it."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from ..geometry.plane import ImagePlane
from ..simulator.imaging import Imager
from ..simulator.scene import Scene
from ..simulator.simulated_frame import SimulatedFrame

Array = NDArray[np.float64]

_TARGET, _ASIDE, _AXIS = (255, 213, 74), (214, 120, 60), (92, 200, 255)
"""Colours: of a target in the image's plane and out of it, of the needle's axis."""
_ARM_MM, _GAP_MM, _LINE_PX = 4.0, 1.2, 1.6
_AXIS_SHARE = 0.55
"""Of the axis' colour over the image, so that the needle's own echo is seen below it."""


class Painter:
    """Makes pictures of a scene's frames, also of those that were made without one."""

    def __init__(self, scene: Scene, pixels: int) -> None:
        self._scene, self._pixels = scene, pixels
        self._imager: Imager | None = None

    def paint(self, frame: SimulatedFrame) -> NDArray[np.uint8]:
        """Return the picture (rows, columns, 3) of a frame."""
        probe, place, imager = frame.probe, frame.probe_to_reference, self._imager
        imager = self._scene.see(probe, place) if imager is None else imager
        self._imager = imager if imager.is_aimed(probe, place) else imager.aimed(probe, place)
        settings = replace(frame.settings, pixels=self._pixels)
        image = self._imager.render(
            frame.field, frame.needle, frame=frame.number, settings=settings, time_s=frame.time_s
        )
        canvas = np.repeat(image.pixels[..., None].astype(float), 3, axis=2)
        if frame.needle is not None:
            ends = image.plane.pixels(np.stack([frame.needle.entry, frame.needle.tip]))
            _draw(canvas, ends[0], ends[1], _AXIS, _AXIS_SHARE)
        self._mark(canvas, image.plane, frame)
        return np.rint(canvas).astype(np.uint8)

    def _mark(self, canvas: Array, plane: ImagePlane, frame: SimulatedFrame) -> None:
        """A cross with an open middle where the target is now, or is nearest to the plane."""
        away, half_slice = frame.out_of_plane(frame.target_now)
        colour = _TARGET if abs(away) <= half_slice else _ASIDE
        middle = plane.pixels(frame.target_now)
        for along in np.concatenate([np.eye(2), -np.eye(2)]):
            gap, arm = (length / plane.spacing_mm[0] * along for length in (_GAP_MM, _ARM_MM))
            _draw(canvas, middle + gap, middle + arm, colour, 1.0)

    def __repr__(self) -> str:
        return f"Painter({self._scene!r}, {self._pixels} pixels)"


def _draw(canvas: Array, start: Array, end: Array, colour: tuple[int, int, int], share: float) -> None:
    """Draw a line of a colour, in place, its edges softened over a pixel."""
    rows, columns = np.ogrid[: canvas.shape[0], : canvas.shape[1]]
    along = end - start
    t = ((columns - start[0]) * along[0] + (rows - start[1]) * along[1]) / max(float(along @ along), 1e-12)
    t = np.clip(t, 0, 1)
    beside = np.hypot(columns - start[0] - t * along[0], rows - start[1] - t * along[1])
    cover = share * np.clip(_LINE_PX / 2 + 0.5 - beside, 0, 1)[..., None]
    canvas += cover * (np.array(colour, float) - canvas)

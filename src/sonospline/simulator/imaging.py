"""What the probe's picture is made of: synthesised from a label map, or cut from a real volume."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..geometry.plane import ImagePlane
from ..ultrasound.artefacts import Artefacts
from ..ultrasound.display import GREY_MAPS, Display, slider_db
from ..ultrasound.doppler import Doppler
from ..ultrasound.frame import Frame
from ..ultrasound.needle_echo import NeedleEcho
from ..ultrasound.optics import picture_plane, picture_shape
from ..ultrasound.phantom import Phantom
from ..ultrasound.probe import Probe
from ..ultrasound.reslice import Reslicer
from ..ultrasound.synthesis import Scanner
from .command import ImageSettings

Array = NDArray[np.float64]

_BOX_WIDE, _BOX_HIGH, _MOST_LEAN = 0.5, 0.36, 0.7
"""Of the probe's face and the image's depth: the colour box."""
_MARGIN_MM = 8.0
"""Displacement allowed for before scatterers have to be chosen anew."""


class Imager(ABC):
    """A probe at a pose, which makes one picture after the other."""

    probe: Probe
    probe_to_reference: Array

    def is_aimed(self, probe: Probe, probe_to_reference: Array) -> bool:
        """Return whether it is this probe, at this pose."""
        return probe == self.probe and bool((probe_to_reference == self.probe_to_reference).all())

    @abstractmethod
    def aimed(self, probe: Probe, probe_to_reference: Array) -> Imager:
        """Return the imager with another probe or at another pose."""

    @abstractmethod
    def render(
        self, field: GridField, needle: Needle | None, *, frame: int, settings: ImageSettings, time_s: float = 0.0
    ) -> Frame:
        """Return the picture of the deformed tissue with the needle in it, at a time."""


class SyntheticImager(Imager):
    """B-mode of a label map."""

    def __init__(self, scanner: Scanner, probe_to_reference: Array, base: Display) -> None:
        self._scanner, self._base = scanner, base
        self.probe, self.probe_to_reference = scanner.probe, probe_to_reference

    @classmethod
    def of(
        cls,
        phantom: Phantom,
        probe: Probe,
        probe_to_reference: Array,
        *,
        display: Display,
        echo: NeedleEcho,
        artefacts: Artefacts,
    ) -> SyntheticImager:
        """Return the imager of a phantom."""
        scanner = Scanner(
            phantom, probe, probe_to_reference, display=display, needle_echo=echo, artefacts=artefacts,
            margin_mm=_MARGIN_MM,
        )  # fmt: skip
        return cls(scanner, probe_to_reference, display)

    def aimed(self, probe: Probe, probe_to_reference: Array) -> SyntheticImager:
        old = self._scanner
        if probe == self.probe:
            return SyntheticImager(old.moved(probe_to_reference), probe_to_reference, self._base)
        return SyntheticImager.of(
            old.phantom, probe, probe_to_reference, display=self._base, echo=old.needle_echo, artefacts=old.artefacts
        )  # fmt: skip

    def render(
        self, field: GridField, needle: Needle | None, *, frame: int, settings: ImageSettings, time_s: float = 0.0
    ) -> Frame:
        shape = picture_shape(self.probe, settings.pixels)
        if shape != self._scanner.plane.shape:
            self._scanner = self._scanner.with_picture(shape)
        knobs = {
            "gain_db": self._base.gain_db + settings.gain, "tgc_db": settings.tgc_db, "grey_map": settings.grey_map,
        }  # fmt: skip
        if any(getattr(self._scanner.display, name) != value for name, value in knobs.items()):
            self._scanner = self._scanner.with_display(**knobs)
        doppler = colour_box(self.probe, settings) if self._scanner.phantom.flows else None
        if doppler != self._scanner.doppler:
            self._scanner = self._scanner.with_doppler(doppler)
        return self._scanner.render(field, needle, frame=frame, time_s=time_s).frame


class ReslicedImager(Imager):
    """Cuts of a real volume, the needle painted on them; what a real image does not know (frequency, focus) is left."""

    def __init__(
        self, reslicer: Reslicer, grey: tuple[float, float], probe: Probe, probe_to_reference: Array, needle_mm: float
    ) -> None:
        self._reslicer, self._grey, self._needle_mm = reslicer, grey, needle_mm
        self.probe, self.probe_to_reference = probe, probe_to_reference
        self._draw_on(512)

    def _draw_on(self, pixels: int) -> None:
        self._pixels = pixels
        self._plane = picture_plane(self.probe, self.probe_to_reference, None, pixels)
        self._fan, self._depth = _fan(self.probe, self._plane)

    def aimed(self, probe: Probe, probe_to_reference: Array) -> ReslicedImager:
        return ReslicedImager(self._reslicer, self._grey, probe, probe_to_reference, self._needle_mm)

    def render(
        self, field: GridField, needle: Needle | None, *, frame: int, settings: ImageSettings, time_s: float = 0.0
    ) -> Frame:
        if settings.pixels != self._pixels:
            self._draw_on(settings.pixels)
        cut = self._reslicer.cut(self._plane, field)
        black, white = self._grey
        added = (settings.gain + slider_db(settings.tgc_db, self.probe.depth_mm, self._depth)).astype(np.float32)
        grey = (cut.pixels.astype(np.float32) - black) * (255 / (white - black)) + added * (255 / 60)
        if needle is not None:
            paint_needle(grey, self._plane, needle, self._needle_mm)
        seen = self._fan if cut.mask is None else self._fan & cut.mask
        seen = seen & ~np.isnan(grey)  # where the volume itself knows nothing
        shown = GREY_MAPS[settings.grey_map][np.where(seen, np.clip(grey, 0, 255), 0).astype(np.uint8)]
        return Frame(np.where(seen, shown, 0).astype(np.uint8), self._plane, seen)


def paint_needle(grey: NDArray[np.float32], plane: ImagePlane, needle: Needle, diameter_mm: float) -> None:
    """Brighten, in place, the pixels a needle comes near: a Gaussian of its diameter and the pixel."""
    sigma = 0.5 * diameter_mm + max(plane.spacing_mm)
    points = np.stack([needle.entry, needle.tip])
    ends, pixel = plane.project(points), plane.pixels(points)
    reach = 4 * sigma / min(plane.spacing_mm)
    low = np.maximum(np.floor(pixel.min(axis=0) - reach), 0).astype(int)
    high = np.minimum(np.ceil(pixel.max(axis=0) + reach) + 1, plane.shape[::-1]).astype(int)
    if (high <= low).any():
        return
    x, y = plane.axes_mm
    x, y = x[low[0] : high[0]], y[low[1] : high[1]]
    along = (ends[1] - ends[0]) / needle.depth
    t = np.clip((x - ends[0, 0]) * along[0] + (y - ends[0, 1]) * along[1] - ends[0, 2] * along[2], 0, needle.depth)
    foot = [ends[0, a] + t * along[a] for a in range(3)]
    squared = (x - foot[0]) ** 2 + (y - foot[1]) ** 2 + foot[2] ** 2
    window = grey[low[1] : high[1], low[0] : high[0]]
    bright = np.exp(-0.5 * squared / sigma**2).astype(np.float32)
    window += bright * np.maximum(250 - window, 0)


def out_of_plane(probe: Probe, probe_to_reference: Array, point: Array) -> tuple[float, float]:
    """Return how far a point is out of the image plane, away from the viewer, and half the slice there, mm."""
    local = (point - probe_to_reference[:3, 3]) @ probe_to_reference[:3, :3]
    beam = probe.beam_coordinates(local[None])[0]
    sigma = float(probe.elevation_sigma(np.clip(beam[0], 0, probe.depth_mm)))
    return float(local[2]), float(np.sqrt(2 * np.log(2)) * sigma)


def tuned(probe: Probe, settings: ImageSettings) -> Probe:
    """Return a probe with its knobs where a settings has them, sampled finely enough for its pulse."""
    asked = (settings.depth, settings.frequency, settings.focus, settings.transmit)
    if asked != (probe.depth_mm, probe.frequency_mhz, probe.elevation_focus_mm, probe.transmit_focus_mm):
        depth, frequency, focus, transmit = asked
        probe = probe.tuned(
            frequency_mhz=frequency, depth_mm=depth, elevation_focus_mm=focus, transmit_focus_mm=transmit
        )  # fmt: skip
    return probe.in_harmonic_mode() if settings.mode == "harmonic" else probe


def colour_box(probe: Probe, settings: ImageSettings) -> Doppler | None:
    """Return colour Doppler as a settings asks for it, its box held within the image; none where it is off."""
    if settings.colour == "off" or probe.kind == "phased":
        return None
    steer = 0.0 if probe.curved else settings.steer
    half, high = probe.aperture_mm / 2, _BOX_HIGH * probe.depth_mm
    steepest = float(np.degrees(np.arctan(2 * _MOST_LEAN * half / high)))
    steer = float(np.clip(steer, -steepest, steepest))
    lean = high / 2 * abs(float(np.tan(np.radians(steer))))
    wide = min(_BOX_WIDE * probe.aperture_mm, 2 * (half - lean))
    aside = half - lean - wide / 2
    across = float(np.clip(settings.box_across, -aside, aside))
    deep = float(np.clip(settings.box_depth, high / 2, probe.depth_mm - high / 2))
    box = (across - wide / 2, across + wide / 2, deep - high / 2, deep + high / 2)
    asked = Doppler(box_mm=box, prf_hz=settings.prf, steer_deg=steer)
    return replace(asked, prf_hz=min(settings.prf, asked.fastest_prf_hz(probe)))


def grey_range(voxels: NDArray[Any], seen: NDArray[np.bool_]) -> tuple[float, float]:
    """Return what counts as black and as white in a volume: bytes as they are, else all but the last per mille."""
    if voxels.dtype == np.uint8:
        return 0.0, 255.0
    shown = voxels[seen] if seen.any() else voxels
    if np.issubdtype(shown.dtype, np.floating):
        shown = shown[np.isfinite(shown)]
    low, high = np.quantile(shown, (0.001, 0.999)) if shown.size else (0.0, 1.0)
    return float(low), float(max(high, low + 1e-6))


def _fan(probe: Probe, plane: ImagePlane) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Which pixels a beam passes, and how deep each lies."""
    r, line, _ = probe.beam_coordinates(plane.project(plane.points)).T
    inside = (r >= 0) & (r <= probe.depth_mm) & (line >= 0) & (line <= probe.lines - 1)
    return inside.reshape(plane.shape), r.reshape(plane.shape).astype(np.float32)

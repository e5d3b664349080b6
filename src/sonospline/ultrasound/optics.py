"""What a probe's beams do to echoes, as tables: pulse, beam, slice, and how bright speckle comes out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..geometry.plane import ImagePlane
from .probe import SPEED_OF_SOUND, Probe

Array = NDArray[np.float64]

SCATTERERS_PER_CELL = 8
"""In a resolution cell of volume (2 sqrt(pi))^3 s_r s_l s_e."""
ELEVATION_CUT = 2.75
"""Standard deviations of the slice beyond which nothing is heard."""
CUT_WEIGHT = float(np.exp(-(ELEVATION_CUT**2) / 2))
RAYS, RAY_SAMPLES = 96, 256
MARGIN_MM = 6.0

_SILENT = 1e-5  # share of the beam's peak that is left out
_POINTS_PER_BEAM = 8
_LINES_BESIDE = 2  # beyond the outermost, whose echoes the beams still touch
_APERTURE_RAYS = 1.6  # standard deviation, in coarse beams, of the aperture that blurs shadows
_REACH = 3.3  # standard deviations of the pulse and the beam that are kept
# The linear splat between lines widens the beam: wanted width -> width of the taps, in lines.
_WANTED, _TAPS = (0.0, 0.51, 0.735, 0.94), (0.0, 0.45, 0.65, 0.85)


@dataclass(frozen=True, eq=False)
class Optics:
    """Tables of a probe.

    Echoes are spread linearly over two lines and two half-samples, then convolved: with the taps of the
    pulse along a beam, and those of the beam, which depend on depth, across beams. Both peak at 1.
    """

    probe: Probe
    rays: int = RAYS
    ray_samples: int = RAY_SAMPLES
    points_per_beam: int = _POINTS_PER_BEAM
    faintest: float = 1.0
    """Echo of an interface that is left out, of what the scene leaves out anyway."""

    @property
    def half_sample_mm(self) -> float:
        """Distance between the bins of the splat."""
        return self.probe.sample_mm / 2

    @cached_property
    def axial(self) -> Array:
        """(2 h + 1,) pulse at half-samples; narrower than wanted by what the linear splat adds."""
        step = self.half_sample_mm
        sigma = np.sqrt(self.probe.axial_sigma**2 - step**2 / 6) / step
        half = int(np.ceil(_REACH * sigma))
        return np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)

    @cached_property
    def line_spacing(self) -> Array:
        """(samples,) distance between beams; at the apex, where they meet, that at 2 mm."""
        return self.probe.line_spacing(np.maximum(self.probe.ranges, 2.0 - self.probe.apex_mm))

    @cached_property
    def lateral(self) -> Array:
        """(2 h + 1, samples) beam across lines."""
        wanted = self.probe.lateral_sigma(self.probe.ranges) / self.line_spacing
        sigma = np.where(
            wanted < _WANTED[-1], np.interp(wanted, _WANTED, _TAPS), np.sqrt(np.maximum(wanted**2 - 1 / 6, 0.1))
        )
        sigma = np.clip(sigma, 0.2, 12)  # a phased probe's lines meet at its apex
        half = int(np.ceil(_REACH * sigma.max()))
        beam = np.exp(-0.5 * (np.arange(-half, half + 1)[:, None] / sigma) ** 2)
        return np.where(beam > _SILENT, beam, 0)

    @cached_property
    def speckle_power(self) -> Array:
        """(samples,) P(r), the mean of ``|s|^2``, of scatterers whose density times squared amplitude is 1 / mm^3."""
        probe, pulse, beam = self.probe, self.axial, self.lateral
        along = self.half_sample_mm * (2 / 3 * (pulse**2).sum() + 1 / 3 * (pulse[1:] * pulse[:-1]).sum())
        across = 2 / 3 * (beam**2).sum(axis=0) + 1 / 3 * (beam[1:] * beam[:-1]).sum(axis=0)
        y = np.linspace(-ELEVATION_CUT, ELEVATION_CUT, 2001)
        profile = np.exp(-0.5 * y**2) - CUT_WEIGHT
        slice_ = np.trapezoid(profile**2, y) * probe.elevation_sigma(probe.ranges)
        return along * self.line_spacing * across * slice_

    def density(self, range_mm: Array) -> Array:
        """Return scatterers per mm^3 at a range: so many per resolution cell."""
        probe = self.probe
        r = np.clip(range_mm, 0, probe.depth_mm)
        across = np.maximum(probe.f_number, r / probe.active_aperture_mm)
        return 1 / (self._cell_mm2 * across * probe.elevation_sigma(r))

    @property
    def _cell_mm2(self) -> float:
        """Tissue that a scatterer stands for over max(F#, r / D) s_e."""
        probe = self.probe
        lateral = float(probe.lateral_sigma(0.0)) / probe.f_number
        return float((2 * np.sqrt(np.pi)) ** 3 * probe.axial_sigma * lateral / SCATTERERS_PER_CELL)

    @property
    def _points_per_mm2(self) -> float:
        """How many points on an interface look smooth to the probe: so many in a beam at its narrowest."""
        probe = self.probe
        narrowest = probe.lateral_fwhm(np.linspace(0, probe.depth_mm, 200)).min() * probe.elevation_mm
        return float(self.points_per_beam / narrowest)

    def view(self, margin_mm: float, per_brick: int) -> tuple[float, ...]:
        """Return what the core chooses scatterers by, for displacements up to ``margin_mm``."""
        probe = self.probe
        finest = float(self.density(np.linspace(0, probe.depth_mm, 200)).max())
        numbers = (
            probe.curved, probe.apex_mm, probe.depth_mm, probe.half_angle, 0 if probe.curved else probe.aperture_mm / 2,
            probe.line_step, probe.lines, _LINES_BESIDE * float(probe.line_spacing(probe.depth_mm)), self.cycles_per_mm,
            float(probe.elevation_sigma(probe.elevation_focus_mm)), probe.elevation_spread, probe.elevation_focus_mm,
            ELEVATION_CUT, self._cell_mm2, probe.f_number, probe.active_aperture_mm, margin_mm,
            (per_brick / finest) ** (1 / 3), probe.sample_mm, self._points_per_mm2,
            float(probe.lateral_sigma(0.0)) / probe.f_number, self.faintest,
        )  # fmt: skip
        return tuple(float(number) for number in numbers)

    def power_at(self, range_mm: Array) -> Array:
        """Return P at any range."""
        return np.interp(range_mm, self.probe.ranges, self.speckle_power)

    @property
    def cycles_per_mm(self) -> float:
        """Carrier cycles per mm of range, there and back: 2 f0 / c."""
        return 2 * self.probe.frequency_mhz / SPEED_OF_SOUND

    def shadow_smoothing(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return, for each line, the first coarse beam and the weights that blur shadows across the aperture."""
        line = np.arange(self.probe.lines) * (self.rays - 1) / (self.probe.lines - 1)
        half = int(np.ceil(3 * _APERTURE_RAYS))
        first = np.clip(np.rint(line).astype(np.int32) - half, 0, self.rays - 2 * half - 1)
        at = first[:, None] + np.arange(2 * half + 1)
        weights = np.exp(-0.5 * ((at - line[:, None]) / _APERTURE_RAYS) ** 2)
        return first.astype(np.int32), (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)

    def plan(self, scan: Scan) -> Any:
        """Return the core's plan of this probe and picture."""
        probe = self.probe
        geometry = (
            1 / probe.line_step, self.cycles_per_mm, 1 / self.half_sample_mm,
            probe.elevation_sigma(probe.elevation_focus_mm) ** 2, probe.elevation_spread**2, probe.elevation_focus_mm,
            ELEVATION_CUT**2, CUT_WEIGHT, probe.depth_mm, MARGIN_MM,
        )  # fmt: skip
        first, smoothing = self.shadow_smoothing()
        return _core.active.BmodePlan(
            tuple(float(value) for value in geometry),
            probe.curved, probe.lines, probe.samples, self.axial.astype(np.float32),
            np.ascontiguousarray(self.lateral, np.float32), self.rays, self.ray_samples, first, smoothing, scan.pixel,
            scan.fraction,
        )  # fmt: skip


def picture_plane(
    probe: Probe, probe_to_reference: Array, shape: tuple[int, int] | None, pixels: int = 512
) -> ImagePlane:
    """Return the pixels of a probe's picture: square, as many as the shape or the longer side allows."""
    left, right, top, bottom = probe.footprint
    width, height = right - left, bottom - top
    if shape is None:
        shape = picture_shape(probe, pixels)
    spacing = max(height / shape[0], width / shape[1])
    corner = ((left + right - (shape[1] - 1) * spacing) / 2, (top + bottom - (shape[0] - 1) * spacing) / 2)
    return ImagePlane.placed(probe_to_reference, shape=shape, spacing_mm=(spacing, spacing), corner_mm=corner)


def picture_shape(probe: Probe, pixels: int) -> tuple[int, int]:
    """Return rows and columns of a probe's picture with so many pixels along its longer side."""
    left, right, top, bottom = probe.footprint
    spacing = max(right - left, bottom - top) / pixels
    return round((bottom - top) / spacing), round((right - left) / spacing)


class Scan(NamedTuple):
    """Where the pixels of a picture lie among the samples of the beams."""

    pixel: NDArray[np.int32]
    """(rows, columns) sample before each, counted through all lines; -1 outside the fan."""
    fraction: NDArray[np.uint8]
    """(rows, columns, 2) of the way to the next line and to the next sample, of 256."""
    fan: NDArray[np.bool_]
    """(rows, columns) whether a beam passes."""

    @classmethod
    def of(cls, probe: Probe, plane: ImagePlane) -> Scan:
        """Return the scan conversion of a picture; the plane's pose does not matter."""
        r, line = probe.range_and_line(*(axis.astype(np.float32) for axis in plane.axes_mm))
        sample = r / probe.sample_mm
        fan = (r >= 0) & (r <= probe.depth_mm) & (line >= 0) & (line <= probe.lines - 1)
        line, held = np.clip(line, 0, probe.lines - 1), np.clip(sample, 0, probe.samples - 1)
        l0 = np.minimum(line.astype(np.int32), probe.lines - 2)
        s0 = np.minimum(held.astype(np.int32), probe.samples - 2)
        pixel = np.where(fan & (sample <= probe.samples - 1), l0 * probe.samples + s0, -1).astype(np.int32)
        fraction = np.minimum(256 * np.stack([line - l0, held - s0], axis=-1), 255).astype(np.uint8)
        return cls(pixel, fraction, fan)

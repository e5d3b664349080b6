"""NumPy twin of the core's B-mode synthesis: the same chain, array by array."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .checks import numbered, require, require_spacing
from .clutter import add_clutter, require_clutter
from .surfaces import reflected

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_BIN_PAD = 64
_MOST_SAMPLES = 1 << 26  # of all lines
_SLACK = 64
_FRAME_NUMBERS = 16
_SURFACE_NUMBERS = 5
_MOST_LOSS_DB = 60.0
_BLOCK = 65536  # scatterers at once


class BmodePlan:
    """One probe's tables; :meth:`aim` takes what a pose sees, :meth:`render` makes a frame.

    ``geometry`` holds: lines per step (1/mm or 1/rad), carrier cycles per mm of range, half-samples per mm,
    elevation variance at its focus, squared spread, focus in mm, squared cut, weight at the cut, depth and
    margin in mm.
    """

    def __init__(
        self,
        geometry: Any,
        curved: bool,
        lines: int,
        samples: int,
        axial: Floats,
        lateral: Floats,
        rays: int,
        ray_samples: int,
        smoothing_first: NDArray[np.int32],
        smoothing: Floats,
        pixel: NDArray[np.int32],
        fraction: NDArray[np.uint8],
    ) -> None:
        require(bool(np.isfinite(geometry).all()), "geometry is not finite")
        require(2 <= lines <= 32767, "lines is not between 2 and 32767")
        fitting = samples >= 16 and samples % 16 == 0 and samples <= _MOST_SAMPLES // lines
        require(fitting, "samples is not a multiple of 16, or too many")
        require(len(axial) % 2 == 1 and len(axial) < 2 * _BIN_PAD, "axial has a wrong length")
        require(len(lateral) % 2 == 1 and lateral.shape[1] == samples, "lateral has a wrong shape")
        require(
            rays >= 1 and ray_samples >= 16 and ray_samples % 16 == 0 and ray_samples <= _MOST_SAMPLES // rays,
            "ray_samples is not a multiple of 16, or rays or ray_samples too many",
        )
        taps = smoothing.shape[1]
        require(
            len(smoothing) == lines and len(smoothing_first) == lines and taps <= rays,
            "smoothing is not (lines, taps), or smoothing_first not (lines)",
        )
        sound = smoothing_first.min() >= 0 and smoothing_first.max() <= rays - taps
        require(sound, "smoothing_first has a ray that is none")
        require(pixel.size > 0 and fraction.shape[:2] == pixel.shape, "pixel is empty, or fraction not of its shape")
        corner = (lines - 1) * samples - 2
        require(pixel.max() <= corner, "pixel has a sample beyond the last but one, of the last line but one")
        self._aimed = False
        self.geometry, self.curved, self.lines, self.samples = geometry, curved, lines, samples
        self.axial, self.lateral = axial, lateral
        self.rays, self.ray_samples = rays, ray_samples
        self.across = np.zeros((lines, rays))
        for tap in range(smoothing.shape[1]):
            self.across[np.arange(lines), smoothing_first + tap] += smoothing[:, tap]
        self.seen = pixel >= 0
        self.at = pixel[self.seen]
        self.from_line, self.along = fraction[self.seen].T.astype(np.int32)

    def aim(
        self,
        frames: Floats,
        nodes: NDArray[np.int32],
        starts: NDArray[np.int32],
        place: NDArray[np.uint16],
        amplitude: NDArray[np.int16],
        amplitude_step: float,
        ray_start: Array,
        ray_step: Array,
        labels: NDArray[np.uint8],
        label_index: Array,
        loss_db: Floats,
        impedance: Floats,
        surface_starts: NDArray[np.int32],
        surfaces: Floats,
        surface_width: float,
    ) -> None:
        """Take scatterers by cell, rays and labels."""
        cells = len(nodes)
        require(
            frames.shape == (cells, _FRAME_NUMBERS) and len(starts) == cells + 1,
            "frames is not (cells, 16), or nodes and starts are not for as many cells",
        )
        require(starts[0] >= 0 and bool((np.diff(starts) >= 0).all()), "starts falls, or begins below 0")
        count = int(starts[-1])
        require(
            place.shape[1] == len(amplitude) >= count + _SLACK,
            "place and amplitude do not reach 64 beyond the last scatterer, or differ in length",
        )
        require(
            len(surface_starts) == cells + 1 and surface_starts[0] == 0, "surface_starts is not (cells + 1), from 0"
        )
        each = np.diff(surface_starts)
        counted = bool(((each >= 0) & (each <= np.diff(starts))).all())
        require(counted, "surface_starts falls, or counts more than starts in a cell")
        require(
            len(surfaces) == _SURFACE_NUMBERS and surfaces.shape[1] >= surface_starts[-1] + _SLACK,
            "surfaces is not (5, n), or does not reach 64 beyond the last",
        )
        require(0 <= surface_width <= 9, "surface_width is not between 0 and 9")
        require(len(ray_start) == self.rays == len(ray_step), "ray_start or ray_step is not (rays, 3)")
        require(nodes.min(initial=0) >= 0, "nodes has a number below 0")
        self._aimed, self._lattice_nodes = True, int(nodes.sum(axis=1, dtype=np.int64).max(initial=-1)) + 1
        self.frames, self.nodes, self.starts = frames, nodes, starts
        self.places = (place[:, :count].astype(np.float32) + np.float32(0.5)) / np.float32(65536)
        self.amplitude = amplitude[:count] * np.float32(amplitude_step)
        self.amplitude_step, self.surface_width = amplitude_step, surface_width
        self.surfaces = surfaces[:, : surface_starts[-1]]
        self.surface_cell = np.repeat(np.arange(cells), each)
        first = starts[1:] - each  # of a cell's scatterers that lie on surfaces
        self.surface_at = np.arange(surface_starts[-1]) - np.repeat(surface_starts[:-1] - first, each)
        self.ray_start, self.ray_step = ray_start, ray_step
        self.labels, self.label_index, self.loss_db, self.impedance = labels, label_index, loss_db, impedance

    def render(
        self,
        values: Floats,
        spacing: tuple[float, float, float],
        echoes: Floats,
        shadow: Floats,
        shadow_soft_mm: float,
        noise: Floats,
        noise_level: float,
        offset_db: Floats,
        range_db: float,
        wide: Floats,
        wide_scale: Floats,
        haze: Floats,
        texture: Floats,
        tail_level: float,
        tail_keep: float,
        ghosts: Floats,
        unit: Floats,
        loudness: Floats,
        again: float,
    ) -> tuple[Floats, NDArray[np.uint8], NDArray[np.uint8]]:
        """Return complex beams (lines, samples, 2), their grey levels, and the picture."""
        require(numbered(values.shape[:3], 2), "values has fewer than 2 nodes along an axis, or too many")
        require_spacing(spacing)
        require(len(noise) >= 2 * self.lines * self.samples, "noise is shorter than 2 lines samples")
        require(
            shadow.shape == (2, self.lines) and len(offset_db) == self.samples,
            "shadow is not (2, lines), or offset_db not (samples)",
        )
        require_clutter(
            self.lines,
            self.samples,
            wide,
            wide_scale,
            haze,
            texture,
            tail_level,
            tail_keep,
            ghosts,
            unit,
            loudness,
            again,
        )
        require(self._aimed, "aim first")
        enough = np.prod(values.shape[:3]) >= self._lattice_nodes
        require(enough, "values has fewer nodes than the aim's lattice")
        grid = self._splat(values, spacing, echoes)
        beams = self._axial(grid) * self._gain(values, spacing, shadow, shadow_soft_mm)
        tile = noise[: 2 * self.lines * self.samples].reshape(self.lines, self.samples, 2)
        beams = self._lateral(beams) + np.float32(noise_level) * (tile[..., 0] + 1j * tile[..., 1])
        beams = add_clutter(
            beams, wide, wide_scale, haze, texture, tail_level, tail_keep, ghosts, unit, loudness, again
        )
        power = np.square(beams.real) + np.square(beams.imag)
        level = (10 * np.log10(power + 1e-30) + offset_db + range_db) * (255 / range_db)
        grey = (np.clip(level, 0, 255) + 0.5).astype(np.uint8)
        iq = np.stack([beams.real, beams.imag], axis=-1).astype(np.float32)
        return iq, grey, self._picture(grey)

    def _polynomials(self, values: Floats, spacing: tuple[float, float, float]) -> Floats:
        """Place in each cell (3, 8, cells): lateral, elevation, axial; coefficients of 1 u v w uv uw vw uvw."""
        corner = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)])
        node = self.nodes[:, 0] + corner @ self.nodes[:, 1:].T
        c = values.reshape(-1, 3).T[:, node]
        c[:, 7] += c[:, 1] + c[:, 2] + c[:, 3] - c[:, 0] - c[:, 4] - c[:, 5] - c[:, 6]
        c[:, 4] += c[:, 0] - c[:, 1] - c[:, 2]
        c[:, 5] += c[:, 0] - c[:, 1] - c[:, 3]
        c[:, 6] += c[:, 0] - c[:, 2] - c[:, 3]
        c[:, 1:4] -= c[:, :1]
        for axis in range(3):
            c[axis, 1 + axis] += np.float32(spacing[axis])
        turn = self.frames[:, :9].T.reshape(3, 3, 1, -1)
        return np.stack([row[0] * c[0] + row[1] * c[1] + row[2] * c[2] for row in turn])

    def _heard(self, c: Floats) -> NDArray[np.bool_]:
        """Which cells the slice meets, by their corners' elevation and range."""
        variance, spread, focus, cut, _, depth, margin = self.geometry[3:10]
        u, v, w = np.indices((2, 2, 2), np.float32).reshape(3, 8)
        corners = np.stack([np.ones_like(u), u, v, w, u * v, u * w, v * w, u * v * w], axis=1)
        elevation, further = corners @ c[1], corners @ c[2]
        elevation += self.frames[:, 13]
        nearest = np.maximum(np.maximum(elevation.min(axis=0), -elevation.max(axis=0)), 0)
        range_mm = self.frames[:, 9]
        most = cut * (variance + spread * (np.abs(range_mm - focus) + margin) ** 2)
        heard: NDArray[np.bool_] = (nearest**2 < most) & (range_mm + further.min(axis=0) <= depth + margin)
        return heard

    def _splat(self, values: Floats, spacing: tuple[float, float, float], echoes: Floats) -> NDArray[np.complex64]:
        """Every echo once, linearly between two lines and two half-samples."""
        row = 2 * self.samples + 2 * _BIN_PAD
        polynomials = self._polynomials(values, spacing)
        self._reflect(polynomials)
        count = np.where(self._heard(polynomials), np.diff(self.starts), 0)
        cell = np.repeat(np.arange(len(count), dtype=np.int32), count)
        among = np.arange(len(cell)) + np.repeat(self.starts[:-1] - np.cumsum(count) + count, count)
        blocks = (slice(at, at + _BLOCK) for at in range(0, len(cell), _BLOCK))
        parts = [self._echoes(polynomials, cell[block], among[block]) for block in blocks]
        line, b, re, im = (np.concatenate(kind) for kind in zip(echoes.T, *parts, strict=True))
        whole_line, whole_bin = np.floor(line), np.floor(b)
        here = (whole_line >= -1) & (whole_line < self.lines) & (whole_bin >= -_BIN_PAD)
        here &= (whole_bin < 2 * self.samples + _BIN_PAD - 2) & ((re != 0) | (im != 0))
        g, f = (line - whole_line)[here], (b - whole_bin)[here]
        offset = (whole_line[here].astype(np.int64) + 1) * row + whole_bin[here].astype(np.int64) + _BIN_PAD
        size = (self.lines + 2) * row
        grid = np.empty(size, np.complex64)
        for part, held in ((grid.real, re[here]), (grid.imag, im[here])):
            right = held * g
            sides = (held - right, right)
            each = (w for side in sides for after in (side * f,) for w in (side - after, after))
            sums = [np.bincount(offset, w, size) for w in each]
            for total, moved in zip(sums[1:], (1, row, row + 1), strict=True):
                sums[0][moved:] += total[:-moved]
            part[:] = sums[0]
        return grid.reshape(self.lines + 2, row)[1:-1]

    def _reflect(self, c: Floats) -> None:
        """Amplitudes of the scatterers on surfaces, whose normals the displacement turns."""
        if not len(self.surface_at):
            return
        u, v, w = self.places[:, self.surface_at]
        c = c[:, :, self.surface_cell]
        mixed = c[:, 7] * w + c[:, 4]
        slopes = (
            mixed * v + (c[:, 5] * w + c[:, 1]),
            mixed * u + (c[:, 6] * w + c[:, 2]),
            (c[:, 7] * v + c[:, 5]) * u + (c[:, 6] * v + c[:, 3]),
        )
        place = slopes[0] * u + ((c[:, 6] * w + c[:, 2]) * v + (c[:, 3] * w + c[:, 0]))
        beam = np.zeros_like(place)
        beam[2] = 1
        if self.curved:
            beam[0] = np.clip(place[0] / (place[2] + self.frames[self.surface_cell, 12]), -1, 1)
        turned = reflected(slopes, beam, self.surfaces, self.surface_width, self.amplitude_step)
        self.amplitude[self.surface_at] = turned

    def _echoes(self, polynomials: Floats, cell: NDArray[np.int32], among: NDArray[np.int64]) -> Any:
        """Line, half-sample, real and imaginary part of some scatterers."""
        to_line, cycles_per_mm, to_bin, variance, spread, focus, _, cut_weight = (
            np.float32(number) for number in self.geometry[:8]
        )
        u, v, w = self.places[:, among]
        across, elevation, further = (
            ((c[7] * w + c[4]) * v + (c[5] * w + c[1])) * u + ((c[6] * w + c[2]) * v + (c[3] * w + c[0]))
            for c in (axis[:, cell] for axis in polynomials)
        )
        range0, line0, cycles0, reach, elevation0 = self.frames[:, 9:14].T[:, cell]
        if self.curved:
            q = np.clip(across / (further + reach), -1, 1)
            further += across * q / (1 + np.sqrt(1 + q * q))
            across = np.arctan(q)
        range_mm = further + range0
        elevation += elevation0
        squared = elevation**2 / (variance + spread * (range_mm - focus) ** 2)
        profile = np.maximum(np.exp(np.float32(-0.5) * np.minimum(squared, 9)) - cut_weight, 0)
        cycles = further * cycles_per_mm + cycles0
        cycles -= np.rint(cycles)
        phase = np.float32(-2 * np.pi) * cycles
        line = np.clip(across * to_line + line0, -4, self.lines + 4)
        bins = np.clip(range_mm * to_bin, 2 - _BIN_PAD, 2 * self.samples + _BIN_PAD - 2)
        size = self.amplitude[among] * profile
        return line, bins, size * np.cos(phase), size * np.sin(phase)

    def _axial(self, grid: NDArray[np.complex64]) -> NDArray[np.complex64]:
        half = len(self.axial) // 2
        out = np.zeros((self.lines, self.samples), np.complex64)
        for k, tap in enumerate(self.axial, start=-half):
            start = _BIN_PAD + k
            out += tap * grid[:, start : start + 2 * self.samples : 2]
        return out

    def _lateral(self, beams: NDArray[np.complex64]) -> NDArray[np.complex64]:
        half = len(self.lateral) // 2
        padded = np.pad(beams, ((half, half), (0, 0)))
        out = np.zeros_like(beams)
        for k, taps in enumerate(self.lateral):
            out += taps * padded[k : k + self.lines]
        return out

    def _gain(self, values: Floats, spacing: tuple[float, float, float], shadow: Floats, soft_mm: float) -> Floats:
        """Amplitude left (lines, samples)."""
        smooth = self.across @ self._transmitted(values, spacing)
        smooth = np.column_stack([smooth, smooth[:, -1]])
        ratio = self.ray_samples / self.samples
        at = np.maximum(np.arange(self.samples) * ratio - 0.5, 0)
        low = at.astype(np.int64)
        gain = smooth[:, low] + (at - low) * (smooth[:, low + 1] - smooth[:, low])
        depth_mm = self.geometry[8]
        range_mm = np.arange(self.samples) * depth_mm / self.samples
        begins, left = shadow[:, :, None].astype(np.float64)
        behind = np.clip((range_mm - begins) / soft_mm, 0, 1)
        return (gain * (1 - (1 - left) * behind)).astype(np.float32)

    def _transmitted(self, values: Floats, spacing: tuple[float, float, float]) -> Array:
        """Amplitude left along each coarse beam (rays, ray_samples)."""
        depth = np.arange(self.ray_samples)[:, None, None]
        points = self.ray_start + depth * self.ray_step
        places = self._inverse(values, spacing, points)
        index = places @ self.label_index[:, :3].T + (self.label_index[:, 3] + 0.5)
        inside = np.all((index >= 0) & (index < np.array(self.labels.shape)), axis=-1)
        x, y, z = np.moveaxis(np.where(inside[..., None], index, 0).astype(np.int64), -1, 0)
        label = np.where(inside, self.labels[x, y, z], 0)
        loss = self.loss_db[label].astype(np.float64)
        z1, z2 = self.impedance[label[:-1]].astype(np.float64), self.impedance[label[1:]].astype(np.float64)
        steps = np.minimum(_MOST_LOSS_DB, -20 * np.log10(4 * z1 * z2 / (z1 + z2) ** 2))
        db = np.cumsum(loss, axis=0) - 0.5 * loss  # to the sample's middle
        db[1:] += np.cumsum(steps, axis=0)
        return np.asarray((10 ** (-db / 20)).T)

    def _inverse(self, values: Floats, spacing: tuple[float, float, float], points: Array) -> Array:
        """Where tissue came from at points (ray_samples, rays, 3), from where the last two samples lead."""
        flat, shape = values.reshape(-1, 3), np.array(values.shape[:3])
        strides = np.array([shape[1] * shape[2], shape[2], 1])
        corners = np.array(list(np.ndindex(2, 2, 2))) @ strides
        per_mm = 1 / np.array(spacing)
        places = np.empty_like(points)
        u, change = np.zeros(points.shape[1:]), np.zeros(points.shape[1:])
        for n, p in enumerate(points):
            before = u
            index = np.minimum(np.maximum((p - before - change) * per_mm, 0), shape - 1)
            cell = np.minimum(index.astype(np.int64), shape - 2)
            x, y, z = (index - cell).T
            low, high = 1 - z, z
            weights = np.stack([(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y])
            each = np.stack([weights * low, weights * high], axis=1).reshape(8, -1)
            u = np.einsum("cr,rca->ra", each, flat[(cell @ strides)[:, None] + corners])
            if n:
                change = u - before
            places[n] = p - u
        return places

    def _picture(self, grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
        flat = grey.ravel().astype(np.int32)
        here, beside = (
            256 * flat[at] + self.along * (flat[at + 1] - flat[at]) for at in (self.at, self.at + self.samples)
        )
        level = (256 * here + self.from_line * (beside - here) + 32768) >> 16
        picture = np.zeros(self.seen.shape, np.uint8)
        picture[self.seen] = level
        return picture

"""NumPy twin of the core's B-mode synthesis: the same chain, array by array."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .twin_sampling import sample_lattice

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_BIN_PAD = 64
_INVERSE_STEPS = 2
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
        self.geometry, self.curved, self.lines, self.samples = geometry, curved, lines, samples
        self.axial, self.lateral = axial, lateral
        self.rays, self.ray_samples = rays, ray_samples
        self.across = np.zeros((lines, rays))
        for tap in range(smoothing.shape[1]):
            self.across[np.arange(lines), smoothing_first + tap] += smoothing[:, tap]
        self.pixel, self.fraction = pixel, fraction

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
    ) -> None:
        """Take scatterers by cell, rays and labels."""
        count = int(starts[-1])
        self.frames, self.nodes, self.starts = frames, nodes, starts
        self.places = (place[:, :count].astype(np.float32) + np.float32(0.5)) / np.float32(65536)
        self.amplitude = amplitude[:count] * np.float32(amplitude_step)
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
    ) -> tuple[Floats, NDArray[np.uint8], NDArray[np.uint8]]:
        """Return complex beams (lines, samples, 2), their grey levels, and the picture."""
        grid = self._splat(values, spacing, echoes)
        beams = self._axial(grid) * self._gain(values, spacing, shadow, shadow_soft_mm)
        tile = noise[: 2 * self.lines * self.samples].reshape(self.lines, self.samples, 2)
        beams = self._lateral(beams) + np.float32(noise_level) * (tile[..., 0] + 1j * tile[..., 1])
        power = np.square(beams.real) + np.square(beams.imag)
        level = (10 * np.log10(power + 1e-30) + offset_db + range_db) * (255 / range_db)
        grey = (np.clip(level, 0, 255) + 0.5).astype(np.uint8)
        iq = np.stack([beams.real, beams.imag], axis=-1).astype(np.float32)
        return iq, grey, self._picture(grey)

    def _polynomials(self, values: Floats, spacing: tuple[float, float, float]) -> Floats:
        """Place in each cell (cells, 8, 3): coefficients of 1 u v w uv uw vw uvw; lateral, elevation, axial."""
        flat = values.reshape(-1, 3)
        first, step = self.nodes[:, 0], self.nodes[:, 1:].T
        corner = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)]
        c = np.stack([flat[first + np.dot(which, step)] for which in corner], axis=1)
        c[:, 7] += c[:, 1] + c[:, 2] + c[:, 3] - c[:, 0] - c[:, 4] - c[:, 5] - c[:, 6]
        c[:, 4] += c[:, 0] - c[:, 1] - c[:, 2]
        c[:, 5] += c[:, 0] - c[:, 1] - c[:, 3]
        c[:, 6] += c[:, 0] - c[:, 2] - c[:, 3]
        c[:, 1:4] -= c[:, :1]
        c[:, 1:4] += np.diag(np.asarray(spacing, np.float32))
        return c @ self.frames[:, :9].reshape(-1, 3, 3).swapaxes(1, 2)

    def _splat(self, values: Floats, spacing: tuple[float, float, float], echoes: Floats) -> NDArray[np.complex64]:
        """Every echo once, linearly between two lines and two half-samples."""
        row = 2 * self.samples + 2 * _BIN_PAD
        grid = np.zeros((self.lines + 2) * row, np.complex128)
        polynomials = self._polynomials(values, spacing)
        cell_of = np.repeat(np.arange(len(self.nodes)), np.diff(self.starts))
        parts = [echoes.T.astype(np.float64)]
        for at in range(0, len(cell_of), _BLOCK):
            block = slice(at, at + _BLOCK)
            parts.append(self._echoes(polynomials, cell_of[block], self.places[:, block], self.amplitude[block]))
        for line, b, re, im in parts:
            whole_line, whole_bin = np.floor(line), np.floor(b)
            g, f = line - whole_line, b - whole_bin
            here = (whole_line >= -1) & (whole_line < self.lines) & (whole_bin >= -_BIN_PAD)
            here &= whole_bin < 2 * self.samples + _BIN_PAD - 2
            g, f, value = g[here], f[here], (re + 1j * im)[here]
            offset = ((whole_line[here] + 1) * row + whole_bin[here] + _BIN_PAD).astype(np.int64)
            for side, half in np.ndindex(2, 2):
                weight = value * (g if side else 1 - g) * (f if half else 1 - f)
                index = offset + side * row + half
                grid.real += np.bincount(index, weight.real, len(grid))
                grid.imag += np.bincount(index, weight.imag, len(grid))
        return grid.reshape(self.lines + 2, row)[1:-1].astype(np.complex64)

    def _echoes(self, polynomials: Floats, cell: NDArray[np.int64], place: Floats, amplitude: Floats) -> Any:
        """Line, half-sample, real and imaginary part of some scatterers."""
        to_line, cycles_per_mm, to_bin, variance, spread, focus, _, cut_weight = self.geometry[:8]
        u, v, w = place[..., None]
        c = polynomials[cell]
        across, elevation, further = (
            ((c[:, 7] * w + c[:, 4]) * v + (c[:, 5] * w + c[:, 1])) * u
            + ((c[:, 6] * w + c[:, 2]) * v + (c[:, 3] * w + c[:, 0]))
        ).T
        range0, line0, cycles0, reach, elevation0 = self.frames[cell, 9:14].T
        if self.curved:
            q = np.clip(across / (further + reach), -1, 1)
            further = further + across * q / (1 + np.sqrt(1 + q * q))
            across = np.arctan(q)
        range_mm = further + range0
        squared = (elevation + elevation0) ** 2 / (variance + spread * (range_mm - focus) ** 2)
        profile = np.maximum(np.exp(-0.5 * np.minimum(squared, 9.0)) - cut_weight, 0)
        phase = -2 * np.pi * (further.astype(np.float64) * cycles_per_mm + cycles0)
        line = np.clip(across * to_line + line0, -4, self.lines + 4)
        bins = np.clip(range_mm * to_bin, 2 - _BIN_PAD, 2 * self.samples + _BIN_PAD - 2)
        size = amplitude * profile
        return line.astype(np.float64), bins.astype(np.float64), size * np.cos(phase), size * np.sin(phase)

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
        u = np.zeros((self.rays, 3))
        db, left = np.zeros(self.rays), np.empty((self.rays, self.ray_samples))
        last = None
        for n in range(self.ray_samples):
            p = self.ray_start + n * self.ray_step
            for _ in range(_INVERSE_STEPS):
                u = sample_lattice(values, spacing, p - u)
            index = self.label_index[:, :3] @ (p - u).T + self.label_index[:, 3:] + 0.5
            inside = ((index >= 0) & (index < np.array(self.labels.shape)[:, None])).all(axis=0)
            label = np.where(inside, self.labels[tuple(np.where(inside, index, 0).astype(np.int64))], 0)
            if last is not None:
                z1, z2 = self.impedance[last], self.impedance[label]
                db += np.minimum(_MOST_LOSS_DB, -20 * np.log10(4 * z1 * z2 / (z1 + z2) ** 2))
            last = label
            db += self.loss_db[label]
            left[:, n] = 10 ** ((0.5 * self.loss_db[label] - db) / 20)  # to the sample's middle
        return left

    def _picture(self, grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
        flat = grey.ravel().astype(np.int64)
        at = np.maximum(self.pixel, 0)
        across, along = np.moveaxis(self.fraction.astype(np.int64), -1, 0)
        here = 256 * flat[at] + along * (flat[at + 1] - flat[at])
        after = at + self.samples
        beside = 256 * flat[after] + along * (flat[after + 1] - flat[after])
        mixed = (256 * here + across * (beside - here) + 32768) >> 16
        return np.where(self.pixel < 0, 0, mixed).astype(np.uint8)

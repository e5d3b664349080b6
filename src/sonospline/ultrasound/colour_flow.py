"""The velocity of blood from the pulses of an ensemble, and its colours on the picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from ..geometry.plane import ImagePlane
from .doppler import Doppler
from .optics import Optics
from .probe import FWHM, Probe

Array = NDArray[np.float64]
Complex = NDArray[np.complex64]

NO_FLOW = -128
FULL = 127
"""Level of the Nyquist velocity."""


@dataclass(frozen=True, eq=False, repr=False)
class ColourFlow:
    """What colour Doppler shows over a picture."""

    beams_cm_s: NDArray[np.float32]
    """(lines, samples) velocity along the beams of the box, towards the probe is plus; NaN where none is shown."""
    levels: NDArray[np.int8]
    """(rows, columns) of a window of the picture: velocity over the Nyquist velocity, times 127; -128 for none."""
    corner: tuple[int, int]
    """First row and column of the window."""
    nyquist_cm_s: float
    """Beyond it velocities alias: they are shown as coming from the other end of the scale."""
    outline_mm: Array
    """(m, 2) the box's edge in the image, mm from the middle of the probe's face."""

    @property
    def velocity_cm_s(self) -> NDArray[np.float32]:
        """(rows, columns) of the window: velocity along the beams, NaN where none is shown."""
        found = self.levels.astype(np.float32) * np.float32(self.nyquist_cm_s / FULL)
        found[self.levels == NO_FLOW] = np.nan
        return found

    def over(self, grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a grey picture with the colours on it, (rows, columns, 3)."""
        rgb = np.repeat(grey[..., None], 3, axis=-1)
        row, column = self.corner
        rows, columns = self.levels.shape
        window = rgb[row : row + rows, column : column + columns]
        flows = self.levels != NO_FLOW
        window[flows] = colours()[self.levels[flows].astype(int) + FULL + 1]
        return rgb

    def draw_on(self, ax: Any) -> None:
        """Draw the box and the scale on matplotlib ``Axes`` that show the picture."""
        ax.plot(*self.outline_mm.T, color="white", lw=0.8)
        mappable = require("matplotlib.cm").ScalarMappable(
            require("matplotlib.colors").Normalize(-self.nyquist_cm_s, self.nyquist_cm_s),
            require("matplotlib.colors").ListedColormap(colours()[1:] / 255.0),
        )
        ax.figure.colorbar(mappable, ax=ax, label="cm/s, towards the probe +", shrink=0.5)

    def __repr__(self) -> str:
        return f"ColourFlow(+-{self.nyquist_cm_s:.3g} cm/s, {np.count_nonzero(self.levels != NO_FLOW)} pixels)"


@lru_cache(maxsize=1)
def colours() -> NDArray[np.uint8]:
    """Return the colours of levels -128 to 127, (256, 3): red to yellow towards the probe, blue to cyan away."""
    fast = np.abs(np.arange(-128, 128)) / FULL
    bright, pale = np.minimum(1, 0.35 + 1.1 * fast), np.clip(1.6 * fast - 0.6, 0, 1)
    towards = np.stack([bright, pale * 0.95, 0 * fast], axis=1)
    away = np.stack([0 * fast, pale * 0.95, bright], axis=1)
    return np.rint(255 * np.where(np.arange(-128, 128)[:, None] >= 0, towards, away)).astype(np.uint8)


class Estimate(NamedTuple):
    """Autocorrelation of filtered ensembles."""

    lag_one: Complex
    """(lines, samples) of lag 1: its phase is the velocity."""
    power: NDArray[np.float32]
    """(lines, samples) of lag 0."""


def autocorrelation(pulses: Complex, wall_filter: Array, optics: Optics) -> Estimate:
    """Return the autocorrelation (Kasai 1985) of pulses (ensemble, lines, samples) without what hardly moves.

    The filter (ensemble, ensemble) is applied to each; lags are averaged over a pulse's length and three lines.
    """
    from scipy.ndimage import uniform_filter1d

    moving = np.tensordot(wall_filter.astype(np.float32), pulses, axes=1)
    count, probe = len(pulses), optics.probe
    lag_one = (moving[1:] * moving[:-1].conj()).sum(axis=0) / (count - 1)
    power = (np.square(moving.real) + np.square(moving.imag)).sum(axis=0) / count
    length = max(1, round(FWHM * probe.axial_sigma / probe.sample_mm))
    averaged = [uniform_filter1d(uniform_filter1d(a, length, axis=1), 3, axis=0) for a in (lag_one, power)]
    return Estimate(averaged[0].astype(np.complex64), averaged[1])


def without_polynomial(count: int, order: int) -> Array:
    """Return the projection (count, count) that takes a polynomial out of so many numbers evenly in time."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, count), order + 1))
    left: Array = np.eye(count) - basis @ basis.T
    return left


class BoxScan:
    """Where the pixels of a picture lie among the samples of a box's beams."""

    def __init__(self, doppler: Doppler, probe: Probe, beams: Probe, plane: ImagePlane) -> None:
        x, y = plane.axes_mm
        inside = doppler.inside(probe, x, y)
        held = [np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0)]
        first, last = [int(h[0]) if len(h) else 0 for h in held], [int(h[-1]) + 1 if len(h) else 0 for h in held]
        window = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        self.corner = first[0], first[1]
        self._inside = inside[window]
        pose = doppler.pose(probe)
        at = np.stack(np.broadcast_arrays(x, y), axis=-1)[window][self._inside] - pose[:2, 3]
        r, line = beams.range_and_line(*(at @ pose[:2, :2]).T)
        line = np.clip(line, 0, beams.lines - 1.001)
        sample = np.clip(r / beams.sample_mm, 0, beams.samples - 1.001)
        self._at = line.astype(int) * beams.samples + sample.astype(int)
        self._next = beams.samples
        self._share = (line % 1).astype(np.float32), (sample % 1).astype(np.float32)

    def shown(self, estimate: Estimate, least_power: float) -> NDArray[np.int8]:
        """Return the levels of the window: lags interpolated, so that what aliases has no false colours at its edge."""
        across, along = self._share
        found = []
        for flat in (estimate.lag_one.ravel(), estimate.power.ravel()):
            near = flat[self._at] * (1 - along) + flat[self._at + 1] * along
            beside = flat[self._at + self._next] * (1 - along) + flat[self._at + self._next + 1] * along
            found.append(near * (1 - across) + beside * across)
        turned = np.rint(np.angle(found[0]) * (FULL / np.pi))
        levels = np.full(self._inside.shape, NO_FLOW, np.int8)
        levels[self._inside] = np.where(found[1] >= least_power, turned, NO_FLOW).astype(np.int8)
        return levels

"""Blood that flows through a vessel of a phantom: laminar, fastest in the middle, at rest at the wall."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .scatterers import sobol

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

_MOST = 1 << 17
"""Scatterers in one vessel."""


@dataclass(frozen=True, kw_only=True)
class Flow:
    """Poiseuille flow through a straight vessel, round and tapering, whose volume flow is the same all along.

    Parameters
    ----------
    start, end : (float, float, float)
        Ends of the vessel's axis, RAS mm in undeformed tissue; blood flows from the one to the other.
    radii_mm : (float, float)
        Radius of the lumen at both.
    speed_cm_s : float
        On the axis at the start; the mean there is half of it.

    Raises
    ------
    ValueError
        A vessel without length, a radius that is not above zero, or a speed below zero.

    Examples
    --------
    >>> from sonospline.ultrasound import Flow
    >>> flow = Flow(start=(0, 0, 20), end=(40, 0, 20), radii_mm=(3, 3), speed_cm_s=30)
    >>> flow.speed_at((20, 0, 21.5)).round(1).tolist()  # cm/s, half way from the axis to the wall
    [22.5, 0.0, 0.0]
    """

    start: Vector
    end: Vector
    radii_mm: tuple[float, float]
    speed_cm_s: float

    def __post_init__(self) -> None:
        for name in ("start", "end"):
            object.__setattr__(self, name, tuple(_validate.vector(name, getattr(self, name)).tolist()))
        if self.length_mm == 0:
            raise ValueError(f"start = {self.start} and end are one point; give the two ends of a vessel")
        for number, radius in enumerate(self.radii_mm):
            _validate.number(f"radii_mm[{number}]", radius, positive=True)
        _validate.number("speed_cm_s", self.speed_cm_s)

    @property
    def length_mm(self) -> float:
        """From end to end."""
        return float(np.linalg.norm(np.subtract(self.end, self.start)))

    @property
    def middle(self) -> Array:
        """(3,) half way along the axis."""
        middle: Array = (np.array(self.start) + self.end) / 2
        return middle

    @property
    def fastest_mm_s(self) -> float:
        """On the axis, where the vessel is narrowest."""
        return 10 * self.speed_cm_s * (self.radii_mm[0] / min(self.radii_mm)) ** 2

    def speed_at(self, point: Vector | Array) -> Array:
        """Return the velocity (3,) at a place in undeformed tissue, cm/s; zero outside the vessel."""
        away = np.asarray(point, float) - self.start
        along = float(away @ self.axes[0])
        radius = self.radii_mm[0] + self.taper * along
        apart = np.linalg.norm(away - along * self.axes[0]) / radius
        inside = 0 <= along <= self.length_mm and apart < 1
        speed = self.speed_cm_s * (self.radii_mm[0] / radius) ** 2 * (1 - apart**2) if inside else 0.0
        velocity: Array = speed * self.axes[0]
        return velocity

    def blood(self, per_mm3: float, seed: int) -> Blood:
        """Return its scatterers, so many per mm^3 (at most 131,072 in all)."""
        count = int(np.clip(np.ceil(per_mm3 * self.volume_mm3), 1, _MOST))
        return Blood(self, count, seed)

    @cached_property
    def volume_mm3(self) -> float:
        """Of the lumen."""
        return self.passed(self.length_mm)

    @cached_property
    def axes(self) -> Array:
        """(3, 3): unit vectors along the vessel and across it."""
        along = np.subtract(self.end, self.start) / self.length_mm
        across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        across /= np.linalg.norm(across)
        return np.stack([along, across, np.cross(along, across)])

    @property
    def taper(self) -> float:
        """Growth of the radius along the axis."""
        return (self.radii_mm[1] - self.radii_mm[0]) / self.length_mm

    def passed(self, along_mm: float) -> float:
        """Return the volume of the lumen up to a place along the axis, mm^3."""
        a, b = self.radii_mm[0], self.radii_mm[0] + self.taper * along_mm
        return float(np.pi / 3 * along_mm * (a * a + a * b + b * b))

    def along(self, passed_mm3: Array) -> Array:
        """Return how far along the axis so much of the lumen is passed, mm."""
        a = self.radii_mm[0]
        here = np.cbrt(np.maximum(a**3 + 3 / np.pi * self.taper * passed_mm3, 0))
        found: Array = 3 / np.pi * passed_mm3 / (a * a + a * here + here * here)
        return found


@dataclass(frozen=True, eq=False)
class Blood:
    """The scatterers of a flow; the same seed and time give the same places.

    Each keeps to its streamline, along which the volume that it has passed grows evenly with time; what leaves the
    vessel comes in again at its start.
    """

    flow: Flow
    count: int
    seed: int

    @property
    def amplitude(self) -> float:
        """Of each, where the density times squared amplitude is 1 / mm^3."""
        return float(np.sqrt(self.flow.volume_mm3 / self.count))

    @cached_property
    def signs(self) -> Array:
        """(count,) of plus and minus one."""
        return np.random.default_rng([self.seed, 29]).choice(np.array([-1.0, 1.0]), self.count)

    def between(self, time_s: float, low_mm: float, high_mm: float) -> NDArray[np.intp]:
        """Return which are between two places along the axis at a time."""
        least, most = (self.flow.passed(np.clip(at, 0, self.flow.length_mm)) for at in (low_mm, high_mm))
        passed = self._passed(time_s, slice(None))
        return np.flatnonzero((passed >= least) & (passed <= most))

    def places(self, time_s: float, which: NDArray[np.intp] | slice = slice(None)) -> Array:
        """Return where some are in undeformed tissue at a time, (m, 3) RAS mm."""
        flow = self.flow
        along = flow.along(self._passed(time_s, which))
        radius = flow.radii_mm[0] + flow.taper * along
        axis, one, other = flow.axes
        _, _, _, right, up = self._first
        places: Array = (
            np.array(flow.start) + along[:, None] * axis
            + (radius * right[which])[:, None] * one + (radius * up[which])[:, None] * other
        )  # fmt: skip
        return places

    def rounds(self, time_s: float, which: NDArray[np.intp] | slice = slice(None)) -> Array:
        """Return how often each has left the vessel and come in again, (m,)."""
        first, a_second, whole, _, _ = self._first
        found: Array = np.floor((first[which] + time_s * a_second[which]) / whole)
        return found

    def _passed(self, time_s: float, which: NDArray[np.intp] | slice) -> Array:
        """Volume of the lumen that each has passed."""
        first, a_second, whole, _, _ = self._first
        passed: Array = (first[which] + time_s * a_second[which]) % whole
        return passed

    @cached_property
    def _first(self) -> tuple[Array, Array, float, Array, Array]:
        """Volume passed at the beginning and a second, that of the lumen; and place across it, of its radius."""
        u, v, w = _even(self.count, self.seed).T
        in_the_middle = np.pi * self.flow.radii_mm[0] ** 2 * 10 * self.flow.speed_cm_s  # mm^3/s, were all as fast
        apart, turn, whole = np.sqrt(v), 2 * np.pi * w, self.flow.volume_mm3
        return u * whole, in_the_middle * (1 - v), whole, apart * np.cos(turn), apart * np.sin(turn)


@lru_cache(maxsize=8)
def _even(count: int, seed: int) -> Array:
    """(count, 3) places in a unit cube, evenly spread."""
    shift = np.random.default_rng([seed, 31]).random(3)
    return (sobol(count) / 2.0**24 + shift) % 1.0

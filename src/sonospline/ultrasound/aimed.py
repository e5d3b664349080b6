"""The core's plan of a probe, and the pose and lattice it was last aimed at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from .aim import aim
from .needle_synthesis import SHADOW_SOFT_MM
from .optics import Optics, Scan, picture_plane
from .phantom import Phantom

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


class ClutterInput(NamedTuple):
    """The last arguments of the core's ``BmodePlan.render``."""

    wide: Floats
    wide_scale: Floats
    haze: Floats
    texture: Floats
    tail_level: float
    tail_keep: float
    ghosts: Floats
    unit: Floats
    loudness: Floats
    again: float


NO_CLUTTER = ClutterInput(
    np.zeros((0, 0, 2), np.float32), np.zeros(0, np.float32), np.zeros((0, 0, 2), np.float32),
    np.zeros((0, 0, 2), np.float32), 0.0, 0.0, np.zeros((0, 0), np.float32), np.zeros(0, np.float32),
    np.zeros(0, np.float32), 0.0,
)  # fmt: skip


@dataclass
class Aimed:
    """A plan that is aimed anew where it has to be; shared by scanners that differ in their display alone."""

    optics: Optics
    scan: Scan
    margin_mm: float
    plan: Any = None
    grid: Grid | None = None

    def __post_init__(self) -> None:
        self.plan = self.optics.plan(self.scan)

    @classmethod
    def unseen(cls, optics: Optics, margin_mm: float) -> Aimed:
        """Return a plan whose beams are wanted, and no picture."""
        return cls(optics, Scan.of(optics.probe, picture_plane(optics.probe, np.eye(4), (2, 2))), margin_mm)

    def anew(self, scan: Scan) -> Aimed:
        """Return the plan for another pose or picture."""
        return Aimed(self.optics, scan, self.margin_mm)

    def look(
        self,
        phantom: Phantom,
        probe_to_reference: Array,
        field: GridField,
        largest_mm: float,
        seed: int,
        *,
        diffuse: bool,
        power: Array,
    ) -> bool | None:
        """Choose the scatterers that may come into the slice; False where there are none, None where it has them."""
        if field.grid is self.grid and largest_mm <= self.margin_mm:
            return None
        margin = 1.5 * largest_mm if largest_mm > self.margin_mm else self.margin_mm
        seen = aim(
            phantom, self.optics, probe_to_reference, field.grid, margin, seed, diffuse=diffuse, power=power
        )  # fmt: skip
        self.grid = None  # should the plan fail half way, the next image aims anew
        self.plan.aim(*seen)
        self.grid, self.margin_mm = field.grid, margin
        return bool(len(seen.frames))

    def beams(self, field: GridField, echoes: Floats, shadow: Floats, noise: Floats, noise_level: float) -> Floats:
        """Return what the beams hear of the tissue, echoes and noise alone, (lines, samples, 2)."""
        no_offset = np.zeros(self.optics.probe.samples, np.float32)
        heard: Floats
        heard, _, _ = self.plan.render(
            field.along_axes, field.grid.spacing, echoes, shadow, SHADOW_SOFT_MM, noise, noise_level, no_offset, 60.0,
            *NO_CLUTTER,
        )  # fmt: skip
        return heard

    def __getstate__(self) -> tuple[Optics, Scan, float]:
        return self.optics, self.scan, self.margin_mm

    def __setstate__(self, state: tuple[Optics, Scan, float]) -> None:
        self.__init__(*state)  # type: ignore[misc]


@lru_cache(maxsize=4)
def noise(seed: int, size: int) -> Floats:
    """Return the noise that frames take theirs from."""
    return np.random.default_rng(seed).standard_normal(size, np.float32)

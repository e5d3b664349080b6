"""The core's plan of a probe, and the pose and lattice it was last aimed at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from .aim import aim
from .optics import Optics, Scan
from .phantom import Phantom

Array = NDArray[np.float64]


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
    ) -> bool:
        """Choose the scatterers that may come into the slice, unless it has them; return False where there are none."""
        if field.grid is self.grid and largest_mm <= self.margin_mm:
            return True
        margin = 1.5 * largest_mm if largest_mm > self.margin_mm else self.margin_mm
        seen = aim(
            phantom, self.optics, probe_to_reference, field.grid, margin, seed, diffuse=diffuse, power=power
        )  # fmt: skip
        self.grid = None  # should the plan fail half way, the next image aims anew
        self.plan.aim(*seen)
        self.grid, self.margin_mm = field.grid, margin
        return bool(len(seen.frames))

    def __getstate__(self) -> tuple[Optics, Scan, float]:
        return self.optics, self.scan, self.margin_mm

    def __setstate__(self, state: tuple[Optics, Scan, float]) -> None:
        self.__init__(*state)  # type: ignore[misc]

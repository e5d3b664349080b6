"""The plane of a tissue's lattice in which errors are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import FACES, Grid
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue

_DIGITS = 4
"""Of the numbers of a picture."""


@dataclass(frozen=True)
class DrawnPlane:
    """The lattice plane through the middle of a needle; its first axis is the depth below the entry face."""

    grid: Grid
    axes: tuple[int, int]
    across: int
    sheet: int
    """Its number along the axis across it."""
    reverse: bool
    """Whether the entry face is the last along its axis."""

    @classmethod
    def of(cls, tissue: Tissue, needle: Needle) -> DrawnPlane:
        """Return the plane of a needle."""
        depth, reverse = divmod(FACES.index(tissue.entry_face), 2)
        across = (depth + 1) % 3
        middle = tissue.grid.local(needle.at(0.5)[None])[0] / tissue.grid.spacing
        return cls(tissue.grid, (depth, 3 - depth - across), across, int(np.rint(middle[across])), bool(reverse))

    def cut(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values (nx, ny, nz) at the plane's nodes."""
        plane = np.take(values, self.sheet, axis=self.across)
        plane = plane if self.axes[0] < self.axes[1] else plane.T
        return plane[::-1] if self.reverse else plane

    def size(self, field: NDArray[np.floating]) -> list[list[float]]:
        """Return the length of a displacement (nx, ny, nz, 3) at the plane's nodes, as JSON holds it."""
        size = self.cut(np.linalg.norm(field, axis=-1))
        return [[float(f"{value:.{_DIGITS - 1}e}") for value in line] for line in size]

    def ends(self, needle: Needle) -> list[list[float]]:
        """Return entry and tip, in nodes of the plane."""
        places = self.grid.local(np.stack([needle.entry, needle.tip])) / self.grid.spacing
        if self.reverse:
            places[:, self.axes[0]] = self.grid.shape[self.axes[0]] - 1 - places[:, self.axes[0]]
        ends: list[list[float]] = places[:, self.axes].tolist()
        return ends

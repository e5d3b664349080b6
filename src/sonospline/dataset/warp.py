"""Anatomy that differs from its source: stretched along its axes and bent by a smooth random warp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.random import Generator

from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from ..geometry.volume import Volume
from ..simulator.skin_frame import SkinFrame
from .draws import Array, between, towards_anywhere
from .specification import AnatomyPart

_WAVES = 4
_LENGTH_MM = (50.0, 110.0)
_SKIN_MM = 10.0
"""Below the skin, which stays flat, before the warp has its whole height."""
_NODE_MM = 5.0
"""Between places at which the warp is computed."""
_SLAB = 1 << 18
_ITERATIONS = 40


@dataclass(frozen=True, eq=False)
class Warp:
    """A smooth map from places of an anatomy to those of its source; the skin stays where it is.

    Parameters
    ----------
    frame : SkinFrame
        Of the skin; its origin stays in place.
    axes : (3, 3) ndarray
        Columns, the directions of the stretch.
    scale : (3,) ndarray
        Stretch along each.
    waves : (waves, 7) ndarray
        Of each: displacement (3), wave vector (3) in radians a mm, phase.
    """

    frame: SkinFrame
    axes: Array
    scale: Array
    waves: Array

    @classmethod
    def drawn(cls, random: Generator, part: AnatomyPart, frame: SkinFrame, grid: Grid) -> Self:
        """Draw one."""
        scale = np.array([between(random, part.scale) for _ in range(3)])
        height = between(random, part.warp_mm)
        waves = [
            np.concatenate(
                [
                    height / _WAVES * towards_anywhere(random),
                    2 * np.pi / between(random, _LENGTH_MM) * towards_anywhere(random),
                    [between(random, (0, 2 * np.pi))],
                ]
            )
            for _ in range(_WAVES)
        ]
        return cls(frame, grid.direction, scale, np.stack(waves))

    def source_of(self, places: Array) -> Array:
        """Return where places (m, 3) of the anatomy are in the source."""
        local = (places - self.frame.origin) @ self.axes
        stretched = self.frame.origin + (local / self.scale) @ self.axes.T
        return stretched + self._bent(places)

    def anatomy_of(self, place: Array) -> Array:
        """Return where a place (3,) of the source is in the anatomy: the inverse, by fixed-point iteration."""
        found = place
        for _ in range(_ITERATIONS):
            local = (place - self._bent(found[None])[0] - self.frame.origin) @ self.axes
            found = self.frame.origin + (local * self.scale) @ self.axes.T
        return found

    def labels(self, source: Volume) -> Volume:
        """Return a label map as the anatomy has it, on the same lattice: the nearest voxel at each place."""
        lattice = source.lattice
        grid = Grid.covering(lattice.extent, nodes=_nodes(lattice), origin=lattice.origin, direction=lattice.direction)
        moved = (self.source_of(grid.points) - grid.points).astype(np.float32)
        field = GridField(grid, moved.reshape(*grid.shape, 3))
        found, flat = np.empty_like(source.voxels).reshape(-1), source.voxels
        last = np.array(lattice.shape) - 1
        for start in range(0, found.size, _SLAB):
            index = np.stack(np.unravel_index(np.arange(start, min(start + _SLAB, found.size)), lattice.shape), axis=-1)
            places = lattice.node(index)
            nearest = np.clip(np.rint(source.index(places + field.displacement(places))), 0, last).astype(np.intp)
            found[start : start + _SLAB] = flat[tuple(nearest.T)]
        return replace(source, voxels=found.reshape(lattice.shape))

    def _bent(self, places: Array) -> Array:
        depth = (places - self.frame.origin) @ self.frame.depth
        whole = np.clip(depth / _SKIN_MM, 0, 1)
        waves = [np.cos(places @ wave[3:6] + wave[6])[:, None] * wave[:3] for wave in self.waves]
        bent: Array = whole[:, None] * sum(waves, np.zeros((1, 3)))
        return bent


def _nodes(lattice: Grid) -> int:
    """Nodes every few mm, and no fewer than a lattice has at all."""
    return max(8, int(np.prod(np.ceil(lattice.extent / _NODE_MM) + 1)))

"""A block of tissue that is drawn: skin, fat, muscle and liver, with vessels and a tumour in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ..geometry.volume import Volume
from ..ultrasound.acoustics import TISSUES, AcousticTissue
from ..ultrasound.organs import tissue_of

Array = NDArray[np.float64]

BLOCK_MM = (100.0, 70.0, 60.0)
"""Along the skin, across it, and down from it."""
NAMES = {1: "skin", 2: "fat", 3: "fascia", 4: "muscle", 5: "liver", 6: "vessel wall", 7: "blood", 8: "tumour"}
VOXEL_MM = 0.7
"""Of a block that nobody asked for a voxel of."""

_SKIN, _FAT, _FASCIA, _MUSCLE, _LIVER, _WALL, _BLOOD, _TUMOUR = NAMES
_TUMOUR_BELOW_LIVER_DB = 9.0
_WALL_MM, _FASCIA_MM = 1.0, 1.2


def acoustic_tissue(name: str) -> AcousticTissue:
    """Return how a block's tissue is seen, by its name: a tumour is darker than the liver around it."""
    known = TISSUES[tissue_of(name)]
    return replace(known, backscatter_db=-_TUMOUR_BELOW_LIVER_DB) if name == NAMES[_TUMOUR] else known


@dataclass(frozen=True)
class _Tube:
    """A vessel: a point of its axis, its direction, its radius."""

    at: Array
    along: Array
    radius: float


@dataclass(frozen=True, eq=False)
class Block:
    """One drawn block, as numbers; :meth:`labels` paints it.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.phantoms.drawn_block import Block
    >>> block = Block.drawn(np.random.default_rng(0))
    >>> sorted(block.targets), block.labels(2.0).voxels.shape
    (['tumour', 'vessel'], (51, 36, 31))
    """

    layers: tuple[float, ...]
    """Depth at which fat, fascia, muscle, fascia and liver begin."""
    waves: NDArray[np.float64]
    """(layers, 4) of each layer's end: height, turns over the block's length and width, phase."""
    vessels: tuple[_Tube, ...]
    tumour: tuple[Array, Array]
    """Middle and semi-axes."""

    @classmethod
    def drawn(cls, random: Generator) -> Self:
        """Draw one."""
        skin, fat, muscle = random.uniform(1.2, 2.6), random.uniform(3, 12), random.uniform(4, 12)
        starts = np.cumsum([skin, fat, _FASCIA_MM, muscle, _FASCIA_MM])
        waves = np.column_stack(
            [
                random.uniform((0.1, 0.2, 0.2, 0.3, 0.3), (0.3, 1.2, 1.2, 1.6, 1.6)),
                random.uniform(-2.5, 2.5, 5),
                random.uniform(-2, 2, 5),
                random.uniform(0, 2 * np.pi, 5),
            ]
        )
        waves[2], waves[4] = waves[1], waves[3]  # fascia is of one thickness
        top = float(starts[-1])
        vessels = tuple(_drawn_tube(random, top) for _ in range(1 + int(random.integers(3))))
        axes = random.uniform(3.0, 7.5, 3)
        middle = np.array([random.uniform(35, 65), random.uniform(25, 45), random.uniform(top + 8, min(top + 24, 46))])
        return cls(tuple(starts.tolist()), waves, vessels, (middle, axes))

    @property
    def targets(self) -> dict[str, Array]:
        """Places to aim for."""
        return {"tumour": self.tumour[0], "vessel": self.vessels[0].at}

    def labels(self, voxel_mm: float) -> Volume:
        """Paint it: labels of :data:`NAMES`."""
        shape = [round(side / voxel_mm) + 1 for side in BLOCK_MM]
        x, y, z = (
            (np.arange(n) * voxel_mm).reshape([-1 if a == axis else 1 for a in range(3)])
            for axis, n in enumerate(shape)
        )
        painted = np.full(shape, _SKIN, np.uint8)
        for start, (height, along, across, phase), label in zip(
            self.layers, self.waves, (_FAT, _FASCIA, _MUSCLE, _FASCIA, _LIVER), strict=True
        ):
            turns = along * x / BLOCK_MM[0] + across * y / BLOCK_MM[1]
            painted[z >= start + height * np.sin(2 * np.pi * turns + phase)] = label
        inside = painted == _LIVER
        middle, axes = self.tumour
        level = sum(((c - m) / a) ** 2 for c, m, a in zip((x, y, z), middle, axes, strict=True))
        painted[inside & (level < 1)] = _TUMOUR
        apart = [_distance(tube, x, y, z) for tube in self.vessels]
        for tube, away in zip(self.vessels, apart, strict=True):
            painted[inside & (away < tube.radius + _WALL_MM)] = _WALL
        for tube, away in zip(self.vessels, apart, strict=True):
            painted[inside & (away < tube.radius)] = _BLOOD
        return Volume(voxels=painted, spacing=(voxel_mm,) * 3)


def _drawn_tube(random: Generator, top: float) -> _Tube:
    radius = random.uniform(1.8, 3.6)
    depth = random.uniform(top + radius + 4, min(top + 28, 50))
    turn, rise = random.uniform(0, np.pi), random.uniform(-0.2, 0.2)
    along = np.array([np.cos(turn), np.sin(turn), rise])
    at = np.array([random.uniform(35, 65), random.uniform(25, 45), depth])
    return _Tube(at, along / np.linalg.norm(along), radius)


def _distance(tube: _Tube, x: NDArray[Any], y: NDArray[Any], z: NDArray[Any]) -> Array:
    """How far places are from the axis of a vessel."""
    off = [c - a for c, a in zip((x, y, z), tube.at, strict=True)]
    along: Array = sum(o * d for o, d in zip(off, tube.along, strict=True))
    squared: Array = sum(o * o for o in off)
    return np.sqrt(np.maximum(squared - along * along, 0))

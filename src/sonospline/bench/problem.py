"""What every contender has to compute: displacements at landmarks, carried to all nodes of a cube."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..fields.kernel_field import KernelField
from ..geometry.grid import Grid
from ..models.spline.insertion import Insertion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem:
    """Landmarks on nodes of a unit cube: half on five faces, at rest, half in a tube around a needle."""

    grid: Grid
    nodes: NDArray[np.int64]
    """(n, 3) lattice index of the landmarks, anchors first."""
    values: Array
    """(n, 3) their displacement."""
    anchors: int
    """How many of them are anchors."""

    @classmethod
    def make(cls, side: int, landmarks: int, seed: int = 0) -> Problem:
        """Return the problem for ``side`` nodes a side; the same seed gives the same landmarks."""
        random = np.random.default_rng(seed)
        last = side - 1
        faces = random.integers(0, side, (landmarks // 2, 3))
        axis, end = np.array([(1, 0), (1, 1), (2, 0), (2, 1), (0, 1)])[random.integers(0, 5, len(faces))].T
        faces[np.arange(len(faces)), axis] = end * last
        faces = np.unique(faces, axis=0)
        across = np.clip(random.normal(0.5, 0.06, (8 * landmarks, 2)), 0.1, 0.9)
        tube = np.column_stack([random.uniform(0.02, 0.6, len(across)), across])
        tube = random.permutation(np.unique(np.rint(tube * last).astype(np.int64), axis=0))
        nodes = np.concatenate([faces, tube[: landmarks - len(faces)]])
        off_axis = nodes[:, 1:] / last - 0.5
        decay = np.exp(-0.5 * (off_axis**2).sum(axis=1) / 0.1291**2)
        values = np.column_stack([0.0227 * decay, -0.1 * off_axis * decay[:, None]])
        values[: len(faces)] = 0
        return cls(Grid.unit_cube(side), nodes, values, len(faces))

    @classmethod
    def of(cls, insertion: Insertion) -> Problem:
        """Return what the last step of an insertion solved."""
        field = insertion.field
        assert isinstance(field, KernelField)
        assert field.nodes is not None
        values = field.displacement(field.centres)
        return cls(field.grid or insertion.tissue.grid, field.nodes, values, len(insertion.anchors))

    @property
    def count(self) -> int:
        """Number of landmarks n."""
        return len(self.nodes)

    @cached_property
    def landmarks(self) -> Array:
        """(n, 3) positions of the landmarks."""
        return self.grid.node(self.nodes)

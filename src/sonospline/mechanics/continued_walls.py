"""Walls of a box beyond which tissue goes on: springs in the place of what was cut off.

A crop of a body whose walls are pinned holds tissue where nothing holds it: the same needle moves less of it the
smaller the crop. What lies beyond a wall resists about like springs in proportion to its stiffness and in inverse
proportion to the distance from where tissue is loaded, as a point force's displacement falls with distance (the
elastic part of viscous-spring boundaries: Liu et al., *Earthq. Eng. Eng. Vib.* 5 (2006) 93).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import FACES, face_slice
from ..geometry.tissue import Tissue

Array = NDArray[np.float64]

WALLS = ("pinned", "continued")
"""Whether faces that are not free do not move, or as far as tissue beyond them would let them."""
ACROSS, ALONG = 4.0, 2.0
"""Springs of a wall for displacement across and along it, over shear modulus, area and one over the distance. Around a
point force in tissue without end traction over displacement is 2 in the mean, of incompressible tissue."""


class ContinuedWalls(NamedTuple):
    """What holds the nodes of walls beyond which tissue goes on."""

    springs: Array
    """(3, nx, ny, nz) along the axes, over the shear modulus: mm. Empty where no wall moves."""

    @classmethod
    def none(cls) -> ContinuedWalls:
        """Return no wall that moves."""
        return cls(np.zeros((3, 0, 0, 0)))

    @classmethod
    def of(cls, nodes: Tissue) -> ContinuedWalls:
        """Return the pinned faces of a tissue as walls beyond which it goes on.

        Distances are those from the middle of its box.
        """
        grid = nodes.grid
        from_middle = grid.local(grid.points) - grid.extent / 2
        distance = np.linalg.norm(from_middle, axis=1).reshape(grid.shape)
        lengths = [np.convolve(np.full(n - 1, h), [0.5, 0.5]) for n, h in zip(grid.shape, grid.spacing, strict=True)]
        springs = np.zeros((3, *grid.shape))
        for face in nodes.pinned_faces:
            across, at = FACES.index(face) // 2, face_slice(face)
            area = np.multiply.outer(*(lengths[axis] for axis in range(3) if axis != across))
            for axis in range(3):
                springs[axis][at] += (ACROSS if axis == across else ALONG) * area / distance[at]
        return cls(springs)

    def at_nodes(self, shear: Array) -> Array:
        """Return the springs (3, nx, ny, nz) in kPa mm, from the shear modulus (cx, cy, cz) of each cell; or 0."""
        if not self.springs.size:
            return np.zeros(())
        of_nodes = shear
        for axis in range(3):
            lines = np.moveaxis(of_nodes, axis, 0)
            between = (lines[1:] + lines[:-1]) / 2
            of_nodes = np.moveaxis(np.concatenate([lines[:1], between, lines[-1:]]), 0, axis)
        return np.asarray(self.springs * of_nodes)

    def __repr__(self) -> str:
        return f"ContinuedWalls({int(self.springs.any(axis=0).sum())} nodes)"

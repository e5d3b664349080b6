"""Forces on the nodes of the solver's grid, from the load objects every model shares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core.hexahedra import weigh_along
from ..geometry.grid import FACES
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from .loads import LineLoad, Load
from .shaft import Shaft

Array = NDArray[np.float64]
Single = NDArray[np.float32]


class NodalLoad(NamedTuple):
    """A load on the nodes of a grid."""

    forces: Single
    """(3, nx, ny, nz) along the grid's axes."""
    whole: float
    """All of the load, along the needle: what the nodes take up, and what is lost beyond walls."""

    def __repr__(self) -> str:
        return f"NodalLoad({self.whole:.4g} on {' x '.join(map(str, self.forces.shape[1:]))} nodes)"


def nodal_load(load: Load, needle: Needle, tissue: Tissue, shaft: Shaft | None = None) -> NodalLoad:
    """Return a load on the nodes of a tissue's grid: the integrals of its force per volume times the hat functions.

    Those of a line load are exact at any width, so that its total and first moment are, too; what lies
    beyond the free face is brought back by a mirror. Where tissue has moved, ``shaft`` says which of it
    the needle is in: a line load acts on that, with the forces of the needle's pose. Those of other loads
    go by Numerov's weights.
    """
    if isinstance(load, LineLoad):
        return _line_load(load, needle, tissue, shaft or Shaft.undeformed(needle))
    grid, below = tissue.grid, tissue.depth_below_entry_face(needle.tip)
    local = load.body_force(grid.points, needle, below) @ grid.direction
    forces = np.moveaxis(local.reshape(*grid.shape, 3), -1, 0)
    for axis, spacing in enumerate(grid.spacing):
        forces = weigh_along(forces, axis + 1, spacing)
    return NodalLoad(np.ascontiguousarray(forces, np.float32), load.total_force(needle, below))


def _line_load(load: LineLoad, needle: Needle, tissue: Tissue, shaft: Shaft) -> NodalLoad:
    """The forces of points of the axis: each is a Gaussian, which is a product of three functions of one axis."""
    grid = tissue.grid
    below = tissue.depth_below_entry_face(needle.tip)
    along, amounts = load.along(needle, below).at_points(needle.depth, load.width)
    points = grid.local(shaft.at(along))
    forces = point_forces(tissue, points, amounts, needle.direction @ grid.direction, load.width)
    return NodalLoad(forces, float(amounts.sum()))


def point_forces(tissue: Tissue, points: Array, amounts: Array, direction: Array, width: float) -> Single:
    """Return the nodal load (3, nx, ny, nz) of forces of amounts (m,) along one direction, each smoothed by a Gaussian.

    Points (m, 3) and direction (3,) are along the axes of the tissue's grid, from its first node on.
    """
    grid = tissue.grid
    forces: Single = _core.active.nodal_forces(
        grid.shape, grid.spacing, points, amounts, direction, width, _mirrored(tissue)
    )
    return forces


def point_force_vectors(tissue: Tissue, points: Array, forces: Array, width: float) -> Single:
    """Return the same of forces (m, 3), each along its own direction."""
    grid = tissue.grid
    nodal: Single = _core.active.nodal_force_vectors(grid.shape, grid.spacing, points, forces, width, _mirrored(tissue))
    return nodal


def _mirrored(tissue: Tissue) -> list[bool]:
    return [face in tissue.free_faces for face in FACES]

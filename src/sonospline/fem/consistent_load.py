"""The nodal forces of a load as finite elements integrate it where it is linear between the nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics.loads import Load

Array = NDArray[np.float64]


def consistent_load(load: Load, needle: Needle, tissue: Tissue) -> Array:
    """Return the forces (3, nx, ny, nz) of a load on the nodes of a tissue's grid, along its axes.

    The consistent mass times the force per volume. Under them
    :meth:`sonospline.elasticity.ElasticSolver.equilibrium` and a :class:`FiniteElementModel` on the same
    cells solve the same equations.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.fem.consistent_load import consistent_load
    >>> from sonospline.mechanics import LineForce
    >>> needle = ss.Needle((0, .5, .5), (.6, .5, .5))
    >>> forces = consistent_load(LineForce(), needle, ss.Tissue(ss.Grid.unit_cube(25)))
    >>> round(float(forces[0].sum()), 4), round(LineForce().total_force(needle), 4)
    (0.0244, 0.025)
    """
    grid, below = tissue.grid, tissue.depth_below_entry_face(needle.tip)
    local = load.body_force(grid.points, needle, below) @ grid.direction
    forces = np.moveaxis(local.reshape(*grid.shape, 3), -1, 0)
    for axis, (count, spacing) in enumerate(zip(grid.shape, grid.spacing, strict=True), 1):
        mass = np.diag(np.full(count, 4.0)) + np.eye(count, k=1) + np.eye(count, k=-1)
        mass[0, 0] = mass[-1, -1] = 2
        forces = np.moveaxis(np.tensordot(mass * spacing / 6, forces, (1, axis)), 0, axis)
    return forces

"""Load case D in labelled tissue: a shaft that is held, by the forces that hold it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _definite
from ..elasticity import ElasticSolver
from ..geometry.needle import Needle
from ..mechanics.shaft_displacement import ShaftDisplacement

Array = NDArray[np.float64]

_TOLERANCE = 1e-5
_SMALLEST_CONDITION = 100 * _TOLERANCE
"""Of the nodes' compliance, reciprocal: its entries err by the tolerance, the strengths by a hundredth at most."""


def held_shaft(solver: ElasticSolver, load: ShaftDisplacement, needle: Needle) -> Array:
    """Return the displacement (nx, ny, nz, 3) of the solver's nodes where those at the shaft are held.

    The finite elements of case D without a matrix: one unit force along the needle on each held
    node, and the combination of their responses that displaces these nodes as prescribed.

    Raises
    ------
    ValueError
        The load holds no node of the solver's grid, or so many that their forces cannot be told apart.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.elasticity import ElasticSolver
    >>> from sonospline.mechanics import ShaftDisplacement
    >>> from sonospline.fem.held_shaft import held_shaft
    >>> solver = ElasticSolver(ss.Tissue(ss.Grid.unit_cube(9)), nodes=9**3)
    >>> u = held_shaft(solver, ShaftDisplacement(), ss.Needle((0, .5, .5), (.6, .5, .5)))
    >>> u.shape, round(float(u[2, 4, 4, 0]), 4)
    ((9, 9, 9, 3), 0.0227)
    """
    grid = solver.grid
    along = load.axial_displacement(grid.points, needle)
    along[grid.on_faces(solver.tissue.pinned_faces).ravel()] = np.nan
    nodes = np.flatnonzero(np.isfinite(along))
    if not len(nodes):
        raise ValueError(f"load = {load!r} holds no node of the solver's grid; give a larger radius or a finer grid")
    direction = grid.direction.T @ needle.direction
    responses = np.empty((len(nodes), 3, grid.node_count))
    for response, node in zip(responses, nodes, strict=True):
        force = np.zeros((3, grid.node_count))
        force[:, node] = direction
        state = solver.equilibrium(force.reshape(3, *grid.shape), tolerance=_TOLERANCE)
        response[:] = state.displacement.reshape(3, -1)
    compliance = np.einsum("a,jan->nj", direction, responses[:, :, nodes])
    if _definite.factor(compliance)[1] < _SMALLEST_CONDITION:
        raise ValueError(f"load = {load!r} holds {len(nodes)} nodes that cannot be told apart; give a smaller radius")
    strengths = np.linalg.solve(compliance, along[nodes])
    moved = np.einsum("j,jan->na", strengths, responses) @ grid.direction.T
    return moved.reshape(*grid.shape, 3)

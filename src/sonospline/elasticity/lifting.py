"""Tissue whose held nodes are moved by given displacements: how a face that moves drives what is inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .solver import ElasticSolver

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def driven(solver: ElasticSolver, held: Array | Single, *, tolerance: float = 1e-4) -> Single:
    """Return the displacement of tissue at rest whose held nodes are moved, and on which nothing else acts.

    With L the displacement that is given at held nodes and zero at all others, it is L + v, where A v = -A L at nodes
    that may move and v = 0 at those that are held (Dirichlet lifting).

    Parameters
    ----------
    solver : ElasticSolver
        Its pinned faces and its bone are the held nodes.
    held : (3, nx, ny, nz) ndarray
        Displacement of the held nodes, along the axes of the solver's grid; at others it is not read.
    tolerance : float, default: 1e-4
        Error estimate, relative to v.

    Returns
    -------
    (3, nx, ny, nz) ndarray of float32

    Raises
    ------
    ValueError
        Displacements of another shape, or not finite where nodes are held.
    NotConvergedError
        As :meth:`ElasticSolver.solve`.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> from sonospline.elasticity import ElasticSolver, driven
    >>> bar = ss.Tissue(ss.Grid.unit_cube(13), "z-", pinned_faces=("x-", "x+"))
    >>> solver = ElasticSolver(bar, nodes=13**3)
    >>> held = np.zeros((3, *solver.grid.shape))
    >>> held[0, 0] = 0.1  # the face x- is pushed in, x+ stays
    >>> [round(float(u), 3) for u in driven(solver, held)[0, ::6, 6, 6]]
    [0.1, 0.05, 0.0]
    """
    wanted, free = (3, *solver.grid.shape), solver.free > 0
    if np.shape(held) != wanted:
        raise ValueError(f"held has shape {np.shape(held)}; give displacements of shape {wanted}")
    lift: Single = np.where(free, 0, held).astype(np.float32)
    if not np.isfinite(lift).all():
        raise ValueError("held contains NaN or infinity; give finite displacements at nodes that are held")
    load = -solver.forces(lift) * solver.free
    if not load.any():
        return lift
    return lift + solver.equilibrium(load, tolerance=tolerance).displacement

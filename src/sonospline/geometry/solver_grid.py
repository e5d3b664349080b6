"""The solver's own lattice over a tissue's box: nearly cubic cells, in numbers that halve well."""

from __future__ import annotations

import numpy as np

from .. import _validate
from .grid import Grid

FLATTEST = 10.0
"""Longest over shortest side of a box, at most."""

_FEWEST = 125
"""Nodes of a grid."""
_SLACK = 1e-6
"""Of the longest side, by which two boxes that are one may differ."""
_COUNTS = np.array(sorted({m << k for m in (4, 5, 6, 7, 13) for k in range(8)}))
"""Cells along an axis: a small number times a power of two."""
_BETWEEN = np.sqrt(_COUNTS[1:] * _COUNTS[:-1])
"""Where one count is as near, in ratio, as the next."""


def nodes_resolving(box: Grid, length: float, *, least: int = 25**3, most: int) -> int:
    """Return about how many nodes a grid over a box has whose cells are no longer than a length, within limits.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.geometry.solver_grid import nodes_resolving
    >>> nodes_resolving(ss.Grid(shape=(41, 31, 21), spacing=5.0), 5.0, most=50_000)
    26691
    """
    wanted = float(np.prod(box.extent / length + 1))
    return int(np.clip(wanted, least, most))


def solver_grid(box: Grid, nodes: int | Grid = 25**3) -> Grid:
    """Return a grid of about ``nodes`` nodes over the box of another, for the elastic solver.

    Parameters
    ----------
    box : Grid
        Its origin, direction and extent are taken, its nodes are not.
    nodes : int or Grid, default: 15625
        Nodes wanted; there are as many as the fitting numbers of cells give. Or the grid itself, over the same box.

    Raises
    ------
    ValueError
        A box flatter than 10 : 1, fewer than 125 nodes, or a grid over another box.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.geometry import solver_grid
    >>> solver_grid(ss.Grid.unit_cube(53)).shape
    (25, 25, 25)
    >>> solver_grid(ss.Grid(shape=(60, 41, 31), spacing=2.0), nodes=30_000).shape
    (41, 29, 25)
    """
    flatness = box.extent.max() / box.extent.min()
    if flatness > FLATTEST * (1 + 1e-9):
        raise ValueError(
            f"tissue.grid has sides {np.round(box.extent, 3).tolist()}, longest to shortest {flatness:.1f}; "
            f"give a box of at most {FLATTEST:g} to 1"
        )
    if isinstance(nodes, Grid):
        return _over(box, nodes)
    nodes = _validate.count("nodes", nodes, least=_FEWEST)
    finest = box.extent.min() / _COUNTS[-1]
    spacings = np.geomspace(finest, box.extent.min() / _COUNTS[0], 400)
    candidates = _cells(box.extent / spacings[:, None])
    cells = candidates[np.abs(np.log(np.prod(candidates + 1.0, axis=1) / nodes)).argmin()]
    return Grid(
        shape=(int(cells[0]) + 1, int(cells[1]) + 1, int(cells[2]) + 1),
        spacing=tuple(box.extent / cells),
        origin=box.origin,
        direction=box.direction,
    )


def _over(box: Grid, grid: Grid) -> Grid:
    """The grid, if it fills the box."""
    ours, theirs = (each.world(np.vstack([np.zeros(3), np.diag(each.extent)])) for each in (box, grid))
    if np.abs(ours - theirs).max() > _SLACK * box.extent.max():
        raise ValueError(f"nodes = {grid!r} fills another box than tissue.grid = {box!r}; give one over the same box")
    if grid.node_count < _FEWEST:
        raise ValueError(f"nodes = {grid!r} has {grid.node_count} nodes; give at least {_FEWEST}")
    return grid


def _cells(wanted: np.ndarray) -> np.ndarray:
    """The allowed counts nearest, in ratio, to those wanted."""
    return _COUNTS[np.searchsorted(_BETWEEN, wanted)]

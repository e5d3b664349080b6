"""Coarser and coarser grids over the same box, and the inverse on the coarsest.

Where contrast is low, a coarse cell has the mean moduli of its children. Beside tissue that does not move, or is a
thousand times stiffer, that is a poor guide: there the coarse operators are P^T A P (Galerkin), with P the linear
interpolation, zero at nodes that do not move.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core.hexahedra import Level, cell_matrices, free_nodes, stiffness
from .._core.stencils import coarser, hold, to_sparse
from ..geometry.grid import FACES
from ..geometry.tissue import Tissue
from ..mechanics.moduli import Moduli

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_DENSE = 800
"""Unknowns up to which a level is inverted."""
_HARD = 300.0
"""Stiffest over softest tissue, from which on coarse operators are Galerkin's."""
_EVEN = 1.5
"""An axis is halved while its cells are at most so much longer than the shortest."""


def pinned_faces(tissue: Tissue) -> list[bool]:
    """Return which of the faces, in the order of ``FACES``, do not move."""
    return [face in tissue.pinned_faces for face in FACES]


def is_hard(moduli: Moduli) -> bool:
    """Whether coarse grids need to know more of tissue than its mean moduli."""
    held = moduli.rigid.any() or len(moduli.bone.cells) or moduli.walls.springs.size
    return bool(held or moduli.contrast >= _HARD)


def fixed_nodes(moduli: Moduli, pinned: list[bool]) -> NDArray[np.uint8]:
    """Return the nodes (nx, ny, nz) that do not move: of pinned faces and of rigid cells.

    Raises
    ------
    ValueError
        They are all.
    """
    fixed = ~free_nodes(moduli.shear.shape, pinned) | moduli.rigid_nodes
    if fixed.all():
        raise ValueError(
            "labels: rigid tissue and pinned faces hold every node of the solver's grid, so nothing can move; "
            "give a larger box or more nodes"
        )
    return fixed.astype(np.uint8)


def springs_of(moduli: Moduli, fixed: NDArray[np.uint8]) -> Single:
    """Return the springs (3, nx, ny, nz) that hold nodes which move."""
    return np.where(fixed == 0, moduli.springs, 0).astype(np.float32)


def levels(moduli: Moduli, pinned: list[bool]) -> list[Level]:
    """Return spacing and moduli of each level, the finest first; coarse moduli are means of their children."""
    spacing = np.array(moduli.grid.spacing)
    lame, shear = moduli.lame, moduli.shear
    found = [_level(spacing, lame, shear)]
    while 3 * free_nodes(lame.shape, pinned).sum() > _DENSE:
        cells = np.array(lame.shape)
        halved = _halved(cells, spacing)
        if not halved.any():
            break
        coarse = np.where(halved, -(-cells // 2), cells)
        spacing = spacing * cells / coarse
        lame, shear = (_mean_of_children(values, coarse) for values in (lame, shear))
        found.append(_level(spacing, lame, shear))
    return found


def finest(moduli: Moduli) -> Level:
    """Return spacing and moduli of the finest level."""
    return _level(np.array(moduli.grid.spacing), moduli.lame, moduli.shear)


def galerkin(moduli: Moduli, fixed: NDArray[np.uint8], full: bool) -> list[Single]:
    """Return the operators of the levels below the finest, as stencils over every second node."""
    sides, lame, shear = finest(moduli)
    spacing, nodes, free = np.array(sides), fixed.shape, int((fixed == 0).sum())
    found: list[Single] = []
    while 3 * free > _DENSE:
        halved = _halved(np.array(nodes) - 1, spacing)
        if not halved.any():
            break
        coarse = coarser(nodes, halved)
        if found:
            found.append(_core.active.galerkin_of_stencil(found[-1], coarse))
        else:
            found.append(_core.active.galerkin_of_cells(lame, shear, *cell_matrices(sides, full), fixed, coarse))
            hold(found[-1], springs_of(moduli, fixed))
        spacing, nodes, free = spacing * np.where(halved, 2, 1), coarse, int((found[-1][0] > 0).sum())
    return found if free else found[:-1]


def inverse_of_level(level: Level, pinned: list[bool], full: bool) -> Single:
    """Return the inverse of a level's operator over its free unknowns; (0, 0) where it is too large."""
    return _inverse(stiffness(level, full), free_nodes(level[1].shape, pinned))


def inverse_of_stencil(stencil: Single) -> Single:
    """Return the same of an explicit operator."""
    return _inverse(to_sparse(stencil), stencil[0] > 0)


def _inverse(matrix: Any, free_node: NDArray[np.bool_]) -> Single:
    from scipy.linalg.lapack import dpotrf, dpotri

    free = np.tile(free_node.ravel(), 3)
    if free.sum() > 2 * _DENSE:
        return np.zeros((0, 0), np.float32)
    factor, failed = dpotrf(matrix[free][:, free].toarray(order="F"), lower=True, overwrite_a=True)
    if failed:  # moduli are above zero and a face is pinned, but double precision ends
        raise ValueError("shear moduli leave no solvable system; give stiffnesses in better proportion")
    lower, _ = dpotri(factor, lower=True, overwrite_c=True)
    inverse = lower.astype(np.float32)
    return np.ascontiguousarray(np.tril(inverse) + np.tril(inverse, -1).T)


def _halved(cells: NDArray[np.int64], spacing: Array) -> NDArray[np.bool_]:
    """Which axes the next level halves: those with the shortest cells, while there are enough."""
    many = cells >= 4
    return many & (spacing <= _EVEN * spacing[many].min(initial=np.inf))


def _level(spacing: Array, lame: Array, shear: Array) -> Level:
    sides = float(spacing[0]), float(spacing[1]), float(spacing[2])
    return sides, np.ascontiguousarray(lame, np.float32), np.ascontiguousarray(shear, np.float32)


def _mean_of_children(values: Array, coarse: NDArray[np.int64]) -> Array:
    """Mean over each coarse cell, by volume where a fine cell lies across two."""
    for axis, (fine, count) in enumerate(zip(values.shape, coarse, strict=True)):
        if fine == 2 * count:
            lines = np.moveaxis(values, axis, 0)
            values = np.moveaxis((lines[::2] + lines[1::2]) / 2, 0, axis)
        elif fine != count:
            values = np.moveaxis(np.tensordot(_overlap(fine, int(count)), values, (1, axis)), 0, axis)
    return values


def _overlap(fine: int, coarse: int) -> Array:
    """Share (coarse, fine) of each coarse interval that each fine one covers."""
    edges = np.arange(coarse + 1) / coarse
    low, high = np.arange(fine) / fine, np.arange(1, fine + 1) / fine
    common = np.minimum(edges[1:, None], high) - np.maximum(edges[:-1, None], low)
    return np.maximum(common, 0.0) * coarse

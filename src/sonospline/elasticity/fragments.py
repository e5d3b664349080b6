"""Fragments of bone that float in elastic tissue: six degrees of freedom each, beside the solver's.

With W the fields in which fragments move rigidly and the tissue around them is at rest under no
load, every displacement is u + W q, where fragments do not move in u. A u and W are orthogonal in energy, so
that q = (W' A W)^-1 W' b needs no iteration, and u is that of fixed bone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._shown import shown
from ..geometry.grid import Grid
from ..geometry.tissue import Tissue
from ..mechanics.fragments import Numbers, corners_of

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_TOLERANCE = 1e-5
_AT_A_TIME, _MOST_ITERATIONS = 10, 200


class FloatingFragments:
    """A multigrid solver whose fixed bone includes fragments, and their own motion added.

    Parameters
    ----------
    multigrid : ElasticMultigrid
        The solver around them.
    grid : Grid
        Its nodes.
    fragments : (n, nx, ny, nz) ndarray of bool
        Nodes of each fragment.
    """

    def __init__(self, multigrid: Any, grid: Grid, fragments: NDArray[np.bool_]) -> None:
        self._multigrid = multigrid
        motions = np.concatenate([_rigid_motions(grid, nodes) for nodes in fragments])
        self._nodes = fragments.any(axis=0)
        self._of_nodes = np.linalg.pinv(motions[:, :, self._nodes].reshape(len(motions), -1).astype(float)).T
        self._motions = np.stack([self._carried(motion) for motion in motions])
        self._flat = self._motions.reshape(len(motions), -1)
        products = np.stack([multigrid.product(field).ravel() for field in self._motions])
        stiffness = self._flat.astype(float) @ products.T
        self._compliance = np.linalg.inv((stiffness + stiffness.T) / 2)

    def iterate(self, load: Single, start: Single, iterations: int, estimate: bool) -> tuple[Single, list[float], bool]:
        """Improve a displacement for a load, as the multigrid solver does; errors are relative to all of it."""
        before: Array = self._of_nodes @ start[:, self._nodes].ravel()
        own, errors, sound = self._multigrid.iterate(load, start - self._moved(before), iterations, estimate)
        amounts: Array = self._compliance @ (self._flat @ load.ravel()).astype(float)
        found = own + self._moved(amounts)
        whole = _size(found)
        share = _size(own) / whole if whole > 0 else 1.0
        return found, [error * share for error in errors], sound

    def product(self, values: Single) -> Single:
        """Return the operator times a displacement, forces on fragments included."""
        product: Single = self._multigrid.product(values)
        return product

    def _moved(self, amounts: Array) -> Single:
        moved: Single = amounts.astype(np.float32) @ self._flat
        return moved.reshape(self._motions.shape[1:])

    def _carried(self, motion: Single) -> Single:
        """The field of tissue that one motion of a fragment carries along."""
        load, found = -self._multigrid.product(motion), np.zeros_like(motion)
        for _ in range(_MOST_ITERATIONS // _AT_A_TIME):
            found, errors, _ = self._multigrid.iterate(load, found, _AT_A_TIME, True)
            if errors[-1] <= _TOLERANCE:
                break
        return motion + found

    def __repr__(self) -> str:
        return f"FloatingFragments({shown(self._multigrid)}, {len(self._motions) // 6} fragments)"


def nodes_of_fragments(numbers: Numbers, tissue: Tissue) -> NDArray[np.bool_]:
    """Return the nodes (n, nx, ny, nz) of each fragment, of cells that have the numbers of theirs.

    Raises
    ------
    ValueError
        A fragment at a pinned face of the tissue.
    """
    fragments = [corners_of(numbers == number) for number in range(1, numbers.max(initial=0) + 1)]
    if any((nodes & tissue.pinned).any() for nodes in fragments):
        raise ValueError(
            "labels: a floating fragment touches a pinned face of the box, and so cannot move; "
            "crop the box elsewhere or leave out floating"
        )
    return np.array(fragments, bool)


def _rigid_motions(grid: Grid, nodes: NDArray[np.bool_]) -> Single:
    """Three shifts and three turns about its middle (6, 3, nx, ny, nz) of a fragment's nodes, of like size."""
    index = np.argwhere(nodes) * np.array(grid.spacing)
    place = index - index.mean(axis=0)
    size = float(np.linalg.norm(place, axis=1).max())
    motions = np.zeros((6, 3, *nodes.shape), np.float32)
    for axis in range(3):
        motions[axis, axis, nodes] = 1.0
        motions[3 + axis, :, nodes] = np.cross(np.eye(3)[axis], place) / size
    return motions


def _size(values: Single) -> float:
    return float(np.linalg.norm(values, axis=0).sum(dtype=np.float64))

"""How far the free face of elastic tissue gives way under forces on it: what a body pressed on it needs to know."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._shown import shown
from ..geometry.grid import FACES, face_slice
from .solver import ElasticSolver
from .weighted import weighted

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Single = NDArray[np.float32]

_TOLERANCE = 1e-4
"""Of a column: contact forces follow from differences of displacements."""
_KEPT_BYTES = 200e6
"""What the responses of all nodes of a face may take; where they take more, none is kept."""


class FaceCompliance:
    """Displacements into the tissue of the nodes of its entry face, for unit forces into the tissue on each of them.

    A column takes a solve, from rest whatever was solved before, and is kept: pushes at many places share them. So is
    the displacement of all the tissue that belongs to it, unless a face has too many nodes for that: what forces on the
    face do to the tissue is then a sum, which costs a tenth of a solve.

    Parameters
    ----------
    solver : ElasticSolver
        Its entry face is free.

    Raises
    ------
    ValueError
        The entry face is pinned.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.elasticity import ElasticSolver, FaceCompliance
    >>> face = FaceCompliance(ElasticSolver(ss.Tissue(ss.Grid.unit_cube(13), "z-"), nodes=13**3))
    >>> near = face.between([6 * 13 + 6, 6 * 13 + 7])  # nodes (6, 6) and (6, 7) of the face
    >>> bool(near[0, 0] > abs(near[0, 1])), bool(near[0, 1] == near[1, 0])
    (True, True)
    """

    def __init__(self, solver: ElasticSolver) -> None:
        tissue = solver.tissue
        if tissue.entry_face in tissue.pinned_faces:
            raise ValueError(f"solver = {shown(solver)} pins its entry face {tissue.entry_face}; give one that is free")
        self.solver = solver
        self._at = face_slice(tissue.entry_face)
        self.axis, end = divmod(FACES.index(tissue.entry_face), 2)
        self.inward = -1.0 if end else 1.0
        """Sign of the direction into the tissue along :attr:`axis` of the grid."""
        self.along = tuple(a for a in range(3) if a != self.axis)
        """Axes of the grid along the face."""
        self.shape = tuple(solver.grid.shape[a] for a in self.along)
        """Nodes along them."""
        self._free = solver.free[self._at].ravel() > 0
        self._columns: dict[int, Array] = {}
        self._keeps = self._free.size * solver.rest.displacement.nbytes <= _KEPT_BYTES
        self._responses: dict[int, Single] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_columns": {}, "_responses": {}}

    def between(self, nodes: list[int] | Index) -> Array:
        """Return the displacements (k, k) of nodes of the face, by number in its shape, for forces on each; mm per mN.

        Nodes that do not move have zeros.
        """
        index = np.asarray(nodes)
        found = np.stack([self._column(int(node)) for node in index], axis=1)[index]
        return (found + found.T) / 2

    def load(self, nodes: Index, forces: Array) -> Single:
        """Return forces (3, nx, ny, nz) on the solver's nodes, of forces (k,) into the tissue on nodes of the face."""
        on_face = np.zeros(self._free.size)
        np.add.at(on_face, nodes, forces)
        found = np.zeros((3, *self.solver.grid.shape), np.float32)
        found[self.axis][self._at] = self.inward * (on_face * self._free).reshape(self.shape)
        return found

    def displacement(self, nodes: Index, forces: Array) -> Single:
        """Return the displacement (3, nx, ny, nz) of all the tissue under forces (k,) on nodes of the face, in mN.

        Raises
        ------
        NotConvergedError
            As :meth:`ElasticSolver.equilibrium`.
        """
        if not self._keeps:
            return self.solver.equilibrium(self.load(nodes, forces), tolerance=_TOLERANCE).displacement
        parts = [(float(f), int(node)) for f, node in zip(forces, nodes, strict=True) if f and self._free[node]]
        if not parts:
            return self.solver.rest.displacement
        return weighted([(force, self._response(node)) for force, node in parts])

    def into(self, displacement: Single) -> Array:
        """Return how far the nodes of the face (n,) go into the tissue in a displacement (3, nx, ny, nz)."""
        return self.inward * displacement[self.axis][self._at].ravel().astype(float)

    def _column(self, node: int) -> Array:
        known = self._columns.get(node)
        if known is None:
            known = self.into(self._response(node)) if self._free[node] else np.zeros(self._free.size)
            known.setflags(write=False)
            self._columns[node] = known
        return known

    def _response(self, node: int) -> Single:
        """The displacement of the tissue by 1 mN on a node that may move."""
        known = self._responses.get(node)
        if known is None:
            known = self.solver.equilibrium(self.load(np.array([node]), np.ones(1)), tolerance=_TOLERANCE).displacement
            if self._keeps:
                self._responses[node] = known
        return known

    def __repr__(self) -> str:
        return f"FaceCompliance({self.solver.tissue.entry_face}, {len(self._columns)} of {self._free.size} nodes)"

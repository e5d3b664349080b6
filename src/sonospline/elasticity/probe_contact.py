"""A rigid face pressed on elastic tissue: where it touches, how hard, and what that does inside.

Contact is unilateral and without friction: at each point of the probe's face the force p into the tissue is zero or
more, tissue is pushed in as far as the face is or further, and where it is further there is no force. The forces
are spread over the nodes of the tissue's face by quadratic B-splines, which move with the probe without a jump, and
displacements are taken by the same weights W: the compliance W' G W between the points is symmetric, with G that of
the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._shown import place
from ..mechanics.footprint import Footprint
from ..mechanics.loads import MILLI
from ..mechanics.stiffening import Stiffening
from .face_compliance import FaceCompliance
from .solver import ElasticSolver

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Single = NDArray[np.float32]

DEEPEST = 1 / 3
"""Of the tissue's depth that a probe may be pressed: elsewhere small strain has long ended."""

_RIM = 1.5
"""Cells beside the rim of the face within which nothing is pressed: the weights would take in what does not move."""
_SPACING = 1.08
"""Of points, in cells: finer ones cannot be told apart by the nodes, coarser ones let tissue through between them."""
_SWEEPS, _CLOSE_MM = 20_000, 1e-5


@dataclass(frozen=True, eq=False, repr=False)
class Dent:
    """What a probe does to tissue at one pose."""

    displacement: Single
    """(3, nx, ny, nz) on the solver's nodes, along the axes of its grid, mm."""
    force_n: float
    """Of the probe on the tissue, into it, N; the reaction on the hand is as large."""
    energy_mj: float
    """Energy that is stored in tissue, mJ."""
    pressure_kpa: Array
    """(m,) at the points of the footprint: contact force over the part of the face around each."""

    def __repr__(self) -> str:
        touching = int((self.pressure_kpa > 0).sum())
        return f"Dent({self.force_n:.3g} N, {touching} of {len(self.pressure_kpa)} points touch)"


class ProbeContact:
    """The dents that a rigid footprint makes in the entry face of elastic tissue.

    Small strain: skin at rest is flat, and forces are square to it. Linear elastic, unless tissue stiffens. Points of
    the footprint beyond the face, or within one and a half cells of its rim, touch nothing. The first dent at a place
    takes a solve for each node of the face that it touches; others near it are sums of those.

    Parameters
    ----------
    solver : ElasticSolver
        Its entry face is free.
    footprint : Footprint
        The rigid face.
    stiffening : Stiffening, optional
        How force and energy grow beyond those of linear elastic tissue; they do not by default. Dents stay as they are.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> from sonospline.elasticity import ElasticSolver, ProbeContact
    >>> from sonospline.mechanics import Footprint, Material
    >>> solver = ElasticSolver(ss.Tissue(ss.Grid.covering((100, 100, 60), nodes=9000), "z-"), Material(10), nodes=13**3)
    >>> contact = ProbeContact(solver, Footprint(40, 16))
    >>> dent = contact.dent(ss.facing((50, 50, 5), depth=(0, 0, 1), right=(1, 0, 0)))  # its middle is 5 mm deep
    >>> bool(1 < dent.force_n < 4), dent
    (True, Dent(2.82 N, 10 of 10 points touch))
    """

    def __init__(self, solver: ElasticSolver, footprint: Footprint, stiffening: Stiffening | None = None) -> None:
        self.solver, self.footprint, self.stiffening = solver, footprint, stiffening
        self.face = FaceCompliance(solver)
        self._spacing = np.array([solver.grid.spacing[a] for a in self.face.along])
        self._points = footprint.points(_SPACING * float(self._spacing.max()))

    def depth(self, points: Array) -> Array:
        """Return how deep world points (m, 3) lie below the skin at rest, mm."""
        local = self.solver.grid.local(points)[..., self.face.axis]
        return local if self.face.inward > 0 else self.solver.grid.extent[self.face.axis] - local

    def dent(self, probe_to_reference: Array) -> Dent:
        """Return the dent of a probe at a pose (4, 4): rigid, origin in the middle of its face, y deep, x to the right.

        Raises
        ------
        ValueError
            A middle that is beyond the skin, or a probe pressed deeper than a third of the tissue.
        NotConvergedError
            As :meth:`ElasticSolver.equilibrium`.
        """
        self.check(probe_to_reference)
        return self.unchecked(probe_to_reference)

    def unchecked(self, probe_to_reference: Array) -> Dent:
        """Return the same at any pose: for places between which dents are blended."""
        where = self.footprint_at(probe_to_reference)
        depths, on_face = self.depth(where), self._on_face(where)
        touching = (depths > 0) & self._inside(on_face)
        pressure = np.zeros(len(where))
        if not touching.any():
            return Dent(self.solver.rest.displacement, 0.0, 0.0, pressure)
        nodes, weights = self._weights(on_face[touching])
        compliance = weights.T @ self.face.between(nodes) @ weights
        wanted = depths[touching]
        forces = _pressed(compliance, wanted)
        displacement = self.face.displacement(nodes, weights @ forces)
        energy = float(forces @ compliance @ forces) / 2 / MILLI
        stiffer = 1.0
        if self.stiffening is not None:
            area = self.footprint.area_mm2
            stiffer, energy = self.stiffening.factor(energy, area), self.stiffening.energy_mj(energy, area)
        pressure[touching] = stiffer * forces / self._part
        return Dent(displacement, stiffer * float(forces.sum()) / MILLI, energy, pressure)

    def check(self, probe_to_reference: Array) -> None:
        """Raise ValueError where a probe's middle is beyond the skin, or deeper than may be pressed."""
        middle = probe_to_reference[:3, 3]
        extent = self.solver.grid.extent
        on_face = self.solver.grid.local(middle)[list(self.face.along)]
        if ((on_face < 0) | (on_face > extent[list(self.face.along)])).any():
            raise ValueError(
                f"probe_to_reference has its origin at {place(middle)}, beyond the skin, face "
                f"{self.solver.tissue.entry_face} of the box; slide it back over the tissue"
            )
        deepest = float(self.depth(self.footprint_at(probe_to_reference)).max())
        most = DEEPEST * float(extent[self.face.axis])
        if deepest > most:
            raise ValueError(
                f"probe_to_reference presses {deepest:.4g} mm deep; give at most {most:.4g} mm, a third of the tissue"
            )

    def footprint_at(self, probe_to_reference: Array) -> Array:
        """Return the world positions (m, 3) of the points of the footprint."""
        found: Array = self._points @ probe_to_reference[:3, :3].T + probe_to_reference[:3, 3]
        return found

    @property
    def _part(self) -> float:
        """Area around a point, mm^2."""
        return self.footprint.area_mm2 / len(self._points)

    def _on_face(self, points: Array) -> Array:
        """Coordinates (m, 2) along the face, in cells."""
        found: Array = self.solver.grid.local(points)[:, list(self.face.along)] / self._spacing
        return found

    def _inside(self, on_face: Array) -> NDArray[np.bool_]:
        last = np.array(self.face.shape) - 1
        return np.asarray(((on_face >= _RIM) & (on_face <= last - _RIM)).all(axis=1))

    def _weights(self, on_face: Array) -> tuple[Index, Array]:
        """Numbers (k,) of the nodes around points of the face, and their weights (k, m) at each."""
        nearest = np.rint(on_face).astype(int)
        splines = _quadratic(on_face - nearest)
        first, second = (nearest[:, axis, None] + np.arange(-1, 2) for axis in range(2))
        numbers = (first[:, :, None] * self.face.shape[1] + second[:, None, :]).reshape(len(on_face), 9)
        values = (splines[:, 0, :, None] * splines[:, 1, None, :]).reshape(len(on_face), 9)
        nodes, row = np.unique(numbers, return_inverse=True)
        weights = np.zeros((len(nodes), len(on_face)))
        weights[row.reshape(numbers.shape), np.arange(len(on_face))[:, None]] = values
        return nodes, weights

    def __repr__(self) -> str:
        return f"ProbeContact({self.footprint!r} on {self.solver.tissue.entry_face})"


def _quadratic(beside: Array) -> Array:
    """Quadratic B-splines (..., 3) of the node nearest to a place and its neighbours, by how far beside it it is."""
    return np.stack([(0.5 - beside) ** 2 / 2, 0.75 - beside**2, (0.5 + beside) ** 2 / 2], axis=-1)


def _pressed(compliance: Array, depths: Array) -> Array:
    """Contact forces (m,): at or above zero, and where they are, tissue is as deep as the face."""
    none, unlimited = np.zeros(len(depths)), np.full(len(depths), np.inf)
    forces, _ = _core.active.clipped_forces(compliance, -depths, none, unlimited, none, _SWEEPS, _CLOSE_MM)
    return np.asarray(forces)

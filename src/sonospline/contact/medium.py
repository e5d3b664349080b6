"""The tissue as a needle meets it: what yields to forces at points, and what resists there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..elasticity.hierarchy import is_hard
from ..elasticity.solver import ElasticSolver
from ..geometry.grid import Grid
from ..mechanics.loads import MILLI
from ..mechanics.material import Material
from ..mechanics.membranes import Membrane
from ..mechanics.nodal_displacement import displacement_at, undeformed
from ..mechanics.nodal_load import point_force_vectors
from ..mechanics.tissue_map import TissueMap

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_INVERSE = 40
"""Iterations of the inverse map, at most."""
REUSE = 0.6
"""What closes on a shaft again where it has cut before, over what did at first; assumed."""
_NONE = np.array([0.0, 1.0, 0.0, 0.0])
"""What resists in a fluid, and beyond the tissue."""


class Resistance(NamedTuple):
    """What resists at points (m,): in mN and mm."""

    friction: Array
    """Of a shaft that slides, per length."""
    static: Array
    """Friction of one that sticks over that of one that slides."""
    viscous: Array
    """Friction per length and speed."""
    cutting: Array
    """Force under which a tip cuts."""


@dataclass(frozen=True, eq=False)
class Medium:
    """Elastic tissue under forces at points, each smoothed by a Gaussian of one width.

    Parameters
    ----------
    solver : ElasticSolver
        Of the tissue.
    width : float
        Of the Gaussian, mm.
    reuse : float, default: 0.6
        Friction in a track that the tip has left, over that of a fresh one.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.contact import Medium
    >>> from sonospline.elasticity import ElasticSolver
    >>> from sonospline.mechanics import Material
    >>> tissue = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
    >>> medium = Medium(ElasticSolver(tissue, Material(10), nodes=13**3), width=8.0)
    >>> moved = medium.answer([[30, 50, 50]], [[1000, 0, 0]], iterations=8)  # one newton
    >>> float(medium.moved(moved, [[30, 50, 50]])[0, 0].round(1))  # mm
    1.5
    """

    solver: ElasticSolver
    width: float
    reuse: float = REUSE

    @property
    def membranes(self) -> tuple[Membrane, ...]:
        """What a tip has to break."""
        return self._tissue_map.membranes if isinstance(self._tissue_map, TissueMap) else ()

    @property
    def grid(self) -> Grid:
        """Of the solver's nodes."""
        return self.solver.grid

    @cached_property
    def iterations(self) -> int:
        """How many bring the displacement by a force at a point to that by one at the next, to some per cent.

        That is less than what is not symmetric in a compliance. Beside bone an iteration gains less: one that is a
        tenth off would let forces across a needle grow from step to step.
        """
        return 3 if is_hard(self.solver.moduli) else 1

    def moved(self, displacement: Single, places: Array) -> Array:
        """Return the displacement (m, 3), in the world, of places (m, 3) in undeformed tissue."""
        local = displacement_at(displacement, self.grid, self.grid.local(np.asarray(places, float)))
        turned: Array = local @ self.grid.direction.T
        return turned

    def nodal(self, places: Array, forces: Array) -> Single:
        """Return the forces (3, nx, ny, nz) on the solver's nodes of forces (m, 3), in the world, at places (m, 3)."""
        local = np.asarray(forces, float) @ self.grid.direction
        points = self.grid.local(np.asarray(places, float))
        found: Single = point_force_vectors(self.solver.nodes, points, local, self.width) * self.solver.free
        return found

    def answer(self, places: Array, forces: Array, start: Single | None = None, *, iterations: int) -> Single:
        """Return the displacement (3, nx, ny, nz) under forces at places, some iterations from where it starts."""
        first = self.solver.rest.displacement if start is None else start
        return self.solver.response(self.nodal(places, forces), first, iterations)

    def undeformed(self, displacement: Single, points: Array, start: Array) -> Array:
        """Return where the tissue (m, 3) that is at points now was while undeformed, sought from a start (m, 3)."""
        found = undeformed(displacement, self.grid, self.grid.local(points), self.grid.local(start), _INVERSE)
        return self.grid.world(found)

    def resistance(self, places: Array) -> Resistance:
        """Return what resists a needle at places (m, 3) of undeformed tissue."""
        if isinstance(self._tissue_map, Material):
            return Resistance(*np.tile(_resistance(self._tissue_map)[:, None], len(places)))
        found = [self._resistances.get(int(label), _NONE) for label in self._tissue_map.labels_at(places)]
        return Resistance(*np.transpose(found))

    def strength(self, places: Array) -> Array:
        """Return the force per length (m,), mN/mm, that tissue takes across a needle; 0 in fluids, which hold none."""
        if isinstance(self._tissue_map, Material):
            return np.full(len(places), _strength(self._tissue_map))
        labels = self._tissue_map.labels_at(places)
        return np.array([self._strengths.get(int(label), 0.0) for label in labels])

    def tissue_at(self, place: Array) -> str:
        """Return the name of the tissue at a place (3,); empty where there is one alone."""
        if isinstance(self._tissue_map, Material):
            return ""
        label = int(self._tissue_map.labels_at(place[None])[0])
        return self._tissue_map.names.get(label, f"label {label}")

    def inside(self, places: Array) -> NDArray[np.bool_]:
        """Return whether each of the places (m, 3) is inside each of the membranes: (m, membranes)."""
        if not self.membranes:
            return np.zeros((len(places), 0), bool)
        assert isinstance(self._tissue_map, TissueMap)
        labels = self._tissue_map.labels_at(places)
        return np.array([self._inside_of[int(label)] for label in labels])

    @cached_property
    def _tissue_map(self) -> TissueMap | Material:
        return self.solver.material

    @cached_property
    def _inside_of(self) -> dict[int, list[bool]]:
        assert isinstance(self._tissue_map, TissueMap)
        names = self._tissue_map.names
        return {label: [m.holds(name) for m in self.membranes] for label, name in names.items()}

    @cached_property
    def _strengths(self) -> dict[int, float]:
        assert isinstance(self._tissue_map, TissueMap)
        return {label: _strength(material) for label, material in self._tissue_map.materials.items()}

    @cached_property
    def _resistances(self) -> dict[int, Array]:
        assert isinstance(self._tissue_map, TissueMap)
        return {label: _resistance(material) for label, material in self._tissue_map.materials.items()}

    def __repr__(self) -> str:
        return f"Medium({self.solver!r}, width={self.width:.4g}, {len(self.membranes)} membranes)"


def _strength(material: Material) -> float:
    return 0.0 if material.fluid else MILLI * material.lateral_strength_n_per_mm


def _resistance(material: Material) -> Array:
    if material.fluid:
        return _NONE
    friction, viscous = MILLI * material.sliding_friction_n_per_mm, MILLI * material.viscous_friction
    return np.array([friction, material.static_friction, viscous, MILLI * material.cutting_force_n])

"""What needles load tissue with: where they are in it, once it has moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ...mechanics.loads import LineLoad, Load
from ...mechanics.nodal_load import NodalLoad, nodal_load
from ...mechanics.shaft import Shaft

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Needles = Mapping[str, Needle]

LOAD_AT = ("deformed", "undeformed")
"""Whether a load acts on the tissue that a needle is in, or on what was there before any moved."""
_APART = 0.5
"""Widths of a load between the points at which tissue is looked for; between them its place is interpolated."""
_ERROR_A_WIDTH = 0.12
"""Of the field, relative, where the load is a width beside the needle: 0.05 to 0.2."""
SMALL = 1e-3
"""Error of a field from its loads that is none to speak of."""


@dataclass(frozen=True)
class Loading:
    """Needles, the tissue that each of them loads, and its forces on the solver's nodes."""

    needles: Needles
    shafts: Mapping[str, Shaft]
    """Of those that load tissue which has moved."""
    nodal: Mapping[str, NodalLoad]

    @property
    def total(self) -> Single:
        """Forces of all of them together."""
        first, *others = (load.forces for load in self.nodal.values())
        return sum(others, start=first)


@dataclass(frozen=True)
class NeedleLoads:
    """The load that needles bring, and where it acts."""

    nodes: Tissue
    """With the nodes of a solver."""
    free: Single
    """(nx, ny, nz): 1 at nodes that may move, 0 where a face or bone holds them."""
    load: Load
    at: str
    """One of :data:`LOAD_AT`."""

    def on(self, displacement: Single, needles: Needles, last: Loading) -> Loading:
        """Return the loads of needles in tissue that has moved (3, nx, ny, nz), which the last loads moved.

        A load goes on by what its tissue moved in the last step.
        """
        return self._followed(displacement, needles, last, None)

    def nearer(self, displacement: Single, needles: Needles, last: Loading, most: float = np.inf) -> Loading:
        """Return loads that go part of the way from the last ones to those, if need be, so that they come to rest.

        No further than changes a field by ``most``, relative to it.
        """
        return self._followed(displacement, needles, last, most)

    def _followed(self, displacement: Single, needles: Needles, last: Loading, most: float | None) -> Loading:
        shafts = {}
        if self.at == "deformed" and isinstance(self.load, LineLoad):
            shafts = {name: self._shaft(displacement, name, needle, last, most) for name, needle in needles.items()}
        return self.acting(needles, shafts)

    def _shaft(self, displacement: Single, name: str, needle: Needle, last: Loading, most: float | None) -> Shaft:
        """The shaft of a needle: the last one while it fits, else one found anew; all of the way without a limit."""
        assert isinstance(self.load, LineLoad)
        shaft, was = last.shafts.get(name), last.needles.get(name, needle)
        grid, width = self.nodes.grid, self.load.width
        if shaft is not None and was == needle and self._fits(shaft, needle, displacement):
            return shaft
        found = Shaft.deformed(needle, displacement, grid, _APART * width)
        moved = max(np.linalg.norm(needle.tip - was.tip), np.linalg.norm(needle.entry - was.entry))
        if shaft is None or moved > width:
            return found
        if most is None:
            return found.ahead(needle, shaft, was, grid)
        return found.damped(needle, shaft, was, grid, most * width / _ERROR_A_WIDTH)

    def sought(self, loading: Loading, displacement: Single) -> dict[str, Array]:
        """Return where the tissue (n, 3) of each load is once it has moved (3, nx, ny, nz)."""
        grid, needles = self.nodes.grid, loading.needles
        return {name: shaft.sought(needles[name], displacement, grid) for name, shaft in loading.shafts.items()}

    def error(self, loading: Loading, sought: Mapping[str, Array]) -> float:
        """Return the error of a field, relative, from loads that act beside the tissue that is their needles'."""
        return max((self._error(shaft, sought[name]) for name, shaft in loading.shafts.items()), default=0.0)

    def drifting(self, loading: Loading, first: Loading, last: Loading, sought: Mapping[str, Array]) -> Loading:
        """Return loads after a step, with how far it moved their tissue on since they were first found in it.

        The last loads are those before it.
        """
        shafts = dict(loading.shafts)
        for name in shafts.keys() & last.needles.keys():
            needle, was = loading.needles[name], last.needles[name]
            shafts[name] = shafts[name].drifting(needle, first.shafts[name], was, sought[name])
        return replace(loading, shafts=shafts)

    def acting(self, needles: Needles, shafts: Mapping[str, Shaft]) -> Loading:
        """Return the loads of needles in the tissue that their shafts tell of; without one, where nothing has moved."""
        nodal = {name: self._nodal(needle, shafts.get(name)) for name, needle in needles.items()}
        return Loading(needles, shafts, nodal)

    def forces(self, loading: Loading) -> dict[str, Array]:
        """Return the force (3,) of each needle on the tissue, along the world's axes."""
        turn = self.nodes.grid.direction
        return {name: turn @ load.forces.sum(axis=(1, 2, 3), dtype=np.float64) for name, load in loading.nodal.items()}

    def _nodal(self, needle: Needle, shaft: Shaft | None) -> NodalLoad:
        """What nodes that are held would take moves no tissue."""
        load = nodal_load(self.load, needle, self.nodes, shaft)
        return load._replace(forces=load.forces * self.free)

    def _fits(self, shaft: Shaft, needle: Needle, displacement: Single) -> bool:
        return self._error(shaft, shaft.sought(needle, displacement, self.nodes.grid)) <= SMALL

    def _error(self, shaft: Shaft, sought: Array) -> float:
        assert isinstance(self.load, LineLoad)
        return _ERROR_A_WIDTH * shaft.beside(sought) / self.load.width

"""The authors' earlier model as a baseline: a thin-plate spline in the needle's plane.

It is the two-dimensional model that the paper extends to three dimensions. A plane says
nothing about the tissue beside it, so a volume from it is an assumption: either that the
neighbouring planes do not move, or that they all move as this one does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.needle_plane import NeedlePlane
from ..mechanics.interaction import NeedleTissueModel, accumulated
from .metrics import Errors, displacement_errors
from .reference import Reference

Array = NDArray[np.float64]

_IN_PLANE = 0.5
"""Nodes this near to the plane, in spacings, count as in it."""
_MISSED = 1e-6
"""Largest distance of a landmark from its target, relative to the largest target."""


@dataclass(frozen=True)
class PlaneErrors:
    """Errors of one model in the needle's plane and off it."""

    in_plane: Errors
    """At the nodes of the plane's own lattice."""
    off_plane: Errors
    """At the tissue's nodes more than half a spacing off the plane."""


@dataclass(frozen=True)
class ThinPlateErrors:
    """The thin plate under its two assumptions; in the plane they are the same."""

    still: PlaneErrors
    """The neighbouring planes do not move."""
    carried: PlaneErrors
    """Every parallel plane moves as the needle's does, pinned faces included."""


class ThinPlate:
    r"""A thin-plate spline, U = r^2 log r, through the displaced nodes of the needle's plane.

    The plane has a lattice of its own, with the grid's spacing. Its nodes that the needle
    displaces (eqs 14 to 21, largest so far) and those on its pinned edges are the
    landmarks.

    Parameters
    ----------
    reference : Reference
        An insertion; the needle at its last depth is used.
    model : NeedleTissueModel
        What the needle does to nearby tissue.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> from sonospline.study.insertions import tuning_insertions
    >>> from sonospline.study.reference import Reference
    >>> from sonospline.study.thin_plate import ThinPlate
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(9))
    >>> reference = Reference(tuning_insertions()[0], tissue, (1.0,), np.zeros((1, 9, 9, 9, 3)))
    >>> plate = ThinPlate(reference, ss.NeedleTissueModel.paper())
    >>> plate.plane.normal.tolist(), plate.at_plane_nodes.shape
    ([0.0, 0.0, 1.0], (81, 3))
    """

    def __init__(self, reference: Reference, model: NeedleTissueModel) -> None:
        from scipy.interpolate import RBFInterpolator

        last = reference.last
        grid, needle = last.tissue.grid, last.needle(0)
        self.reference = last
        self.plane = NeedlePlane.through(needle, last.tissue)
        """Where it lives."""
        world = grid.world(self.plane.local(self.plane.nodes))
        targets = accumulated(world, needle, model) @ grid.direction @ self.plane.axes.T
        targets[self.plane.on_pinned_edge] = 0.0
        landmarks = self.plane.on_pinned_edge | targets.any(axis=1)
        self._spline = RBFInterpolator(
            self.plane.nodes[landmarks], targets[landmarks], kernel="thin_plate_spline", degree=1
        )
        self.at_plane_nodes = self._displacement(self.plane.nodes)
        """(m, 3) displacement of the plane's nodes."""
        missed = np.abs(self._spline(self.plane.nodes[landmarks]) - targets[landmarks]).max()
        if not missed <= _MISSED * np.abs(targets).max(initial=0.0):
            raise ValueError(
                f"the thin plate misses its {landmarks.sum()} landmarks by {missed:.1e}: its system is singular to "
                "rounding; use a coarser grid"
            )

    def _displacement(self, places: Array) -> Array:
        return self._spline(places) @ self.plane.axes @ self.reference.tissue.grid.direction.T

    def carried(self) -> Array:
        """Return the displacement (nx, ny, nz, 3) where every parallel plane moves as this one does."""
        grid = self.reference.tissue.grid
        places, _ = self.plane.seen(grid.local(grid.points))
        return self._displacement(np.clip(places, 0, self.plane.lengths)).reshape(*grid.shape, 3)

    def errors(self) -> ThinPlateErrors:
        """Return its errors against the reference, in the plane and off it."""
        carried = self.carried()
        return ThinPlateErrors(
            still=plane_errors(self.reference, np.zeros_like(carried), self.at_plane_nodes),
            carried=plane_errors(self.reference, carried, self.at_plane_nodes),
        )


def plane_errors(reference: Reference, displacement: Array, at_plane_nodes: Array | None = None) -> PlaneErrors:
    """Return a model's errors in the needle's plane and off it, at the last depth of a reference.

    Parameters
    ----------
    reference : Reference
        What the model is compared with; between its nodes it is linear along each axis.
    displacement : (nx, ny, nz, 3) ndarray
        The model's displacement on the grid.
    at_plane_nodes : (m, 3) ndarray, optional
        Its displacement at the plane's own nodes; by default that of the grid, linear
        between nodes.
    """
    last = reference.last
    grid = last.tissue.grid
    plane = NeedlePlane.through(last.needle(0), last.tissue)
    truth = last.displacements[0]
    places = grid.world(np.clip(plane.local(plane.nodes), 0, grid.extent))
    ours = GridField(grid, displacement).displacement(places) if at_plane_nodes is None else at_plane_nodes
    _, distance = plane.seen(grid.local(grid.points))
    off = (distance > _IN_PLANE * min(grid.spacing)).reshape(grid.shape)
    movable = ~plane.on_pinned_edge
    return PlaneErrors(
        in_plane=displacement_errors(ours[movable], GridField(grid, truth).displacement(places[movable])),
        off_plane=displacement_errors(displacement[off], truth[off]),
    )

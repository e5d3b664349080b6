"""The mesh-free middle way: landmarks on the needle's axis dragged along, zeros on the faces."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import _definite, _memory, _validate
from ...fields.grid_field import GridField
from ...fields.kelvinlet_field import KelvinletField
from ...geometry.grid import Grid
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ...mechanics.first_touch import built_up
from ...mechanics.landmarks import select_anchors
from ..contract import Response, State, TissueModel, UnknownForces
from .drag import DragModel

Array = NDArray[np.float64]

_NODES_PER_WIDTH = 2.5
"""Of the lattice a field is kept on: cubics between them are good to 3e-4 of the peak."""
_LARGEST_DRAG = 1e3
"""In sides of the tissue."""
_MOST_ENERGY = 2.0
"""Of a shaft's forces, in that of one force that moves its place by the drag, for each width of the shaft and one
more; poses of the default kernel need 1.6. A displacement is at most the root of energy times compliance."""


class KelvinletModel(TissueModel):
    """Homogeneous tissue without a mesh, by the kernel of :class:`~sonospline.Kelvinlet`.

    Tissue nearer to a pinned face than the kernel's width follows the needle less, in
    proportion to its distance: at the face, where it is held, not at all. With the kernel of
    :meth:`DragModel.kelvinlet` no tissue moves by more than 1.2 times the drag; a kernel may be so
    wide that its forces would fight the anchors, and their energy is limited to twice that of a
    force for every width of the shaft, which keeps displacements below
    drag sqrt(2 (1 + depth / width)).

    Parameters
    ----------
    tissue : Tissue
        Where the needle goes.
    drag : DragModel, optional
        Its effect; by default :meth:`DragModel.kelvinlet` of the grid's side.
    anchors : int, default: 7
        Anchors along each side of a pinned face: 7 x 7 a face are 193 on a cube.

    Raises
    ------
    ValueError
        Anchors so much nearer to one another than the kernel is wide that their forces cannot be told apart.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.models.kelvinlet import KelvinletModel
    >>> model = KelvinletModel(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> response = model.step(model.rest, {"needle": ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5))})
    >>> bool(0.02 < abs(response.field.on_grid()).max() < 0.03)
    True
    """

    name = "kelvinlet"

    def __init__(self, tissue: Tissue, drag: DragModel | None = None, *, anchors: int = 7) -> None:
        super().__init__(tissue)
        self.drag = DragModel.kelvinlet(tissue.grid.side) if drag is None else drag
        if self.drag.drag > _LARGEST_DRAG * tissue.grid.side:
            raise ValueError(
                f"drag = {self.drag.drag:g} is far beyond the tissue's side of {tissue.grid.side:g}; give a part of it"
            )
        self.anchors = select_anchors(tissue, _validate.count("anchors", anchors, least=2))
        self._factor, condition = _definite.factor(self.drag.kernel.matrix(self.anchors, self.anchors))
        if condition < _definite.SMALLEST_CONDITION:
            raise ValueError(
                f"anchors = {anchors} along each side are too near to one another for the kernel's width = "
                f"{self.drag.kernel.width:g} (reciprocal condition {condition:.1e}); give fewer, or a narrower kernel"
            )
        self._lattice = _lattice(tissue.grid, self.drag.kernel.width)

    def _options(self) -> tuple[Any, ...]:
        return self.drag, len(self.anchors)

    def _answer(self, state: State, needles: dict[str, Needle], dt: float) -> Response:
        values = np.zeros((*self._lattice.shape, 3), np.float32)
        for needle in needles.values():
            exact = self.solve(needle).displacement(self._lattice.points)
            values = exact.reshape(values.shape).astype(np.float32)
        field = GridField(self.tissue.grid, values, lattice=self._lattice, order=3)
        return Response(
            state=State(self.identity, tuple(needles.items())), field=field, forces=UnknownForces(self.name)
        )

    def facts(self, response: Response) -> dict[str, Any]:
        """Landmarks and anchors, and the model's parameters."""
        landmarks = sum(len(self.landmarks(needle)) for _, needle in response.state.needles)
        return {"landmarks": landmarks, "anchors": len(self.anchors), "model_mm": asdict(self.drag)}

    def landmarks(self, needle: Needle) -> Array:
        """Return the landmarks (m, 3) on a needle's shaft: the more of the two sets between which it passes."""
        return self._landmarks(needle)[1]

    def _landmarks(self, needle: Needle) -> tuple[Array, Array, float]:
        """Two sets of landmarks, one more in the second, and how much that one counts: none joins with a jump."""
        count = max(needle.depth / self.drag.spacing, 1.0)
        dense = f"the model's spacing = {self.drag.spacing:g}: the system of its {count:.3g} landmarks"
        _memory.refuse_beyond(int(min(250 * count**2, 1e30)), dense, remedy="use a wider one")
        few = int(count)
        fewer, more = (needle.at(np.linspace(0, 1, pieces + 1)) for pieces in (few, few + 1))
        return fewer, more, built_up(count - few, 1.0)

    def solve(self, needle: Needle) -> KelvinletField:
        """Return the exact sum of Kelvinlets for a pose.

        Raises
        ------
        ValueError
            A needle outside the tissue.
        """
        self.tissue.check_inside(entry=needle.entry, tip=needle.tip)
        fewer, more, share = self._landmarks(needle)
        held, dragged = self._forces(needle, more)
        held_before, dragged_before = self._forces(needle, fewer)
        forces = share * held + (1 - share) * held_before, share * dragged, (1 - share) * dragged_before
        centres = np.concatenate([self.anchors, more, fewer])
        return KelvinletField(self.drag.kernel, centres, np.concatenate(forces), self.tissue.grid)

    def _forces(self, needle: Needle, shaft: Array) -> tuple[Array, Array]:
        """Forces at the anchors and at landmarks on the shaft, which hold those and drag these along."""
        from scipy.linalg import cho_solve

        kernel = self.drag.kernel
        follows = np.minimum(self.tissue.distance_to_pinned(shaft) / kernel.width, 1.0)
        drag = self.drag.drag * built_up(needle.depth, self.drag.build_up)
        wanted = np.outer(follows, drag * needle.direction).ravel()
        # Anchors do not move: they leave the system by a Schur complement, their factor is kept.
        across = kernel.matrix(self.anchors, shaft)
        answer = cho_solve((self._factor, True), across)
        most = _MOST_ENERGY * (1 + needle.depth / kernel.width) * drag**2 / kernel.compliance
        on_shaft = _definite.solve(kernel.matrix(shaft, shaft) - across.T @ answer, wanted, most=most)
        return (-answer @ on_shaft).reshape(-1, 3), on_shaft.reshape(-1, 3)


def _lattice(grid: Grid, width: float) -> Grid:
    """The nodes that a field of kernels of a width is kept on, over a grid's box."""
    cells = grid.extent * _NODES_PER_WIDTH / width
    wanted = int(min(40 * float(np.prod(cells + 2)), 1e30))
    _memory.refuse_beyond(wanted, f"the kernel's width = {width:g}: its lattice", remedy="use a wider kernel")
    cells = np.ceil(cells).astype(int) + 1
    return Grid(
        shape=(int(cells[0]) + 1, int(cells[1]) + 1, int(cells[2]) + 1),
        spacing=tuple(grid.extent / cells),
        origin=grid.origin,
        direction=grid.direction,
    )

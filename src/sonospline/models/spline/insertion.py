"""Algorithm 1: a needle advances through tissue, and each step leaves a field."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import _memory, _validate
from ...fields.field import ComposedField, Field, KernelField
from ...fields.kernels import Biharmonic, Kernel
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from .faces import Progress
from .interaction import NeedleTissueModel, interaction
from .landmarks import LandmarkPlan, plan_landmarks, select_anchors
from .spline import PolyharmonicSpline

Array = NDArray[np.float64]
Accumulation = Literal["maximum", "incremental"]


_SHORTEST_STEP = 1e-9
"""In sides of the tissue."""
_LANDMARKS_AHEAD = 96
"""Landmarks factored before the needle wakes them."""


class NeedleInsertion(ABC):
    """What every model of an insertion offers: the field a needle leaves, pose after pose.

    Insertions pickle and deep-copy, into other processes too; a copy goes on to the same bits
    and shares nothing that changes with its original.
    """

    tissue: Tissue
    field: Field

    @abstractmethod
    def advance(self, needle: Needle) -> Field:
        """Move the needle to a pose and return the field it leaves."""

    @abstractmethod
    def reset(self) -> None:
        """Take the needle out and let the tissue return to its undeformed state."""

    def run(self, entry: ArrayLike, target: ArrayLike, steps: int = 20) -> Iterator[Field]:
        """Advance from entry to target in equal steps, yielding the field after each (Sec. V)."""
        _validate.count("steps", steps)
        whole = Needle(entry, target)
        self.tissue.check_inside(entry=whole.entry, target=whole.tip)
        if whole.depth / steps < _SHORTEST_STEP * self.tissue.grid.side:
            raise ValueError(f"steps = {steps} are steps of {whole.depth / steps:.1e}; give fewer")
        return (self.advance(Needle(whole.entry, whole.at(k / steps))) for k in range(1, steps + 1))


class Insertion(NeedleInsertion):
    """A needle insertion into a block of tissue, Algorithm 1.

    Each :meth:`advance` selects landmarks, gives them the displacement the needle causes
    (eqs 14 to 21), pins the anchors, and solves the spline (eqs 1 to 8). A step that
    fails raises and leaves the previous :attr:`field` in force.

    Parameters
    ----------
    tissue : Tissue
        Where the needle goes.
    model : NeedleTissueModel, optional
        Its effect on the tissue; by default Table I scaled to the grid's side.
    kernel : Kernel, default: Biharmonic()
        The spline's kernel.
    anchors : int or "all", default: 5
        Anchors along each side of a pinned face: 5 x 5 a face are 89 on a cube. They hold
        the faces to a few per cent of the peak between them. ``"all"`` pins every node of
        the faces; the first time on a grid this takes seconds, then it is read from disk.
    max_landmarks : int, default: 300
        Most landmarks over the whole way the needle could go.
    smoothing : float, default: 0.0
        As for :class:`PolyharmonicSpline`.
    accumulation : {"maximum", "incremental"}, default: "maximum"
        How targets accumulate. ``"maximum"``: every step maps the undeformed tissue to
        targets that are, per node, the largest displacement met so far (Sec. V); the
        field depends on the needle's pose alone, so pulling back and re-inserting work.
        ``"incremental"``: Algorithm 1 as printed, every step displaces the mesh the last
        one left; use :meth:`NeedleTissueModel.paper_incremental` with it.
    progress : callable, optional
        Called as ``progress(done, of)`` during the set-up of ``anchors="all"``.

    Examples
    --------
    >>> import sonospline as ss
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(25), entry_face="x-")
    >>> insertion = ss.Insertion(tissue, model=ss.NeedleTissueModel.paper())
    >>> field = insertion.advance(ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5)))
    >>> field.on_grid().shape
    (25, 25, 25, 3)
    >>> bool(0.02 < abs(field.on_grid()).max() < 0.03)
    True
    """

    def __init__(
        self,
        tissue: Tissue,
        model: NeedleTissueModel | None = None,
        *,
        kernel: Kernel | None = None,
        anchors: int | Literal["all"] = 5,
        max_landmarks: int = 300,
        smoothing: float = 0.0,
        accumulation: Accumulation = "maximum",
        progress: Progress | None = None,
    ) -> None:
        if not isinstance(tissue, Tissue):
            raise ValueError(f"tissue = {tissue!r} is not a Tissue; make one, e.g. Tissue(Grid.unit_cube(53))")
        self.tissue = tissue
        self.model = NeedleTissueModel.paper(tissue.grid.side) if model is None else model
        self.kernel = Biharmonic() if kernel is None else kernel
        self.smoothing = _validate.number("smoothing", smoothing)
        self.accumulation = _validate.choice("accumulation", accumulation, ("maximum", "incremental"))
        self.max_landmarks = _validate.count("max_landmarks", max_landmarks)
        self._pins_all_nodes = anchors == "all"
        self._spline = self._anchored_spline(anchors, progress)
        self.anchors = self._spline.points
        self._anchor_nodes = np.rint(tissue.grid.local(self.anchors) / tissue.grid.spacing).astype(np.int64)
        self.reset()

    def reset(self) -> None:
        """Take the needle out and let the tissue return to its undeformed state."""
        self.needle: Needle | None = None
        self.plan: LandmarkPlan | None = None
        self.landmark_count = 0
        self._factored_plan: LandmarkPlan | None = None
        self._spline.truncate(len(self.anchors))
        self.field: Field = self._spline.solve(np.zeros_like(self.anchors), grid=self.tissue.grid)

    def _anchored_spline(self, anchors: int | Literal["all"], progress: Progress | None) -> PolyharmonicSpline:
        if anchors == "all":
            if self.accumulation == "incremental":
                raise ValueError(
                    "anchors = 'all' needs accumulation='maximum'; the moving mesh is factored anew each step"
                )
            return PolyharmonicSpline.pinning_faces(
                self.tissue, kernel=self.kernel, smoothing=self.smoothing, progress=progress
            )
        return self._new_spline(select_anchors(self.tissue, _validate.count("anchors", anchors, least=2)))

    def _new_spline(self, points: Array) -> PolyharmonicSpline:
        return PolyharmonicSpline(points, kernel=self.kernel, smoothing=self.smoothing)

    def advance(self, needle: Needle) -> Field:
        """Move the needle to a pose and return the field it leaves.

        Parameters
        ----------
        needle : Needle
            Entry and tip, both inside the tissue. A needle on another axis than the last
            one starts a new pass.

        Raises
        ------
        ValueError
            A needle outside the tissue, or (incremental only) one that does not advance.
        """
        self.tissue.check_inside(entry=needle.entry, tip=needle.tip)
        plan = self._plan_for(needle)
        if self.accumulation == "maximum":
            count = plan.active_count(needle.depth)
            field: Field = self._map_reference(needle, plan, count)
        else:
            field, count = self._move_mesh(needle, plan)
        self.needle, self.plan, self.field, self.landmark_count = needle, plan, field, count
        return field

    def _plan_for(self, needle: Needle) -> LandmarkPlan:
        if self.plan is not None and self.needle is not None and _same_axis(self.needle, needle):
            return self.plan
        return plan_landmarks(self.tissue, needle, self.model, max_landmarks=self.max_landmarks)

    def _map_reference(self, needle: Needle, plan: LandmarkPlan, count: int) -> KernelField:
        """One step from the undeformed tissue: only landmarks new to the factor are appended."""
        anchors = len(self.anchors)
        if plan is not self._factored_plan:
            self._spline.truncate(anchors)
            size = anchors + len(plan.points)
            what = f"max_landmarks = {self.max_landmarks}: the factor of {size:,} landmarks"
            _memory.refuse_beyond(8 * size**2, what, remedy="use fewer landmarks")
            self._spline.reserve(size)
            self._factored_plan = plan
        known = len(self._spline.points) - anchors
        if count > known:
            # Many at once are cheaper than a few at every step, and the solve takes as many as it needs;
            # with every face node pinned one costs as much as all.
            ahead = len(plan.points) if self._pins_all_nodes else count + _LANDMARKS_AHEAD
            self._spline.append(plan.points[known:ahead])
        values = np.zeros((anchors + count, 3))
        values[anchors:] = plan.history.at(needle.depth, count)
        field = self._spline.solve(values, grid=self.tissue.grid)
        return replace(field, nodes=np.concatenate([self._anchor_nodes, plan.nodes[:count]]))

    def _move_mesh(self, needle: Needle, plan: LandmarkPlan) -> tuple[ComposedField, int]:
        """One step of Algorithm 1 as printed: displace the mesh the last step left."""
        grid = self.tissue.grid
        if self.needle is not None and _same_axis(self.needle, needle) and needle.depth <= self.needle.depth:
            raise ValueError(
                f"tip = {needle.tip.tolist()} does not advance; accumulation='incremental' cannot pull back, "
                "use 'maximum' or reset()"
            )
        last = self.field if isinstance(self.field, ComposedField) else ComposedField((), grid, grid.points)
        nodes = np.ravel_multi_index(tuple(plan.nodes.T), grid.shape)
        displacements = interaction(last.nodes[nodes], needle, self.model)
        moved = displacements.any(axis=1)
        points = np.vstack([self.anchors, last.nodes[nodes][moved]])
        values = np.vstack([np.zeros_like(self.anchors), displacements[moved]])
        step = self._new_spline(points).solve(values, grid=grid)
        return ComposedField((*last.steps, step), grid, step.forward(last.nodes)), int(moved.sum())


def _same_axis(a: Needle, b: Needle) -> bool:
    apart = np.abs(a.entry - b.entry).max() / max(a.depth, b.depth)
    return bool(max(apart, np.abs(a.direction - b.direction).max()) <= 1e-9)

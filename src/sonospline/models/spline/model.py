"""The paper's model: landmarks displaced by Table I, anchors on the faces, a spline between them."""

from __future__ import annotations

import threading
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import _memory, _validate
from ...fields.composed_field import ComposedField
from ...fields.field import Field
from ...fields.kernel import Kernel
from ...fields.kernel_field import KernelField
from ...fields.polyharmonic import Biharmonic
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ...mechanics.first_touch import built_up
from ...mechanics.interaction import NeedleTissueModel, interaction
from ...mechanics.landmarks import LandmarkPlan, plan_landmarks, select_anchors
from ..contract import Response, State, TissueModel, UnknownForces
from .faces import Progress
from .spline import PolyharmonicSpline

Array = NDArray[np.float64]
Accumulation = Literal["maximum", "incremental"]

_BATCH = 96
"""Landmarks factored at once. The bits of a factor depend on its batches: they always end at multiples of this."""


@dataclass(frozen=True, eq=False, repr=False)
class SplineState(State):
    """The needle, and what its pass remembers."""

    began: Needle | None = None
    """The pose that began the pass: landmarks are chosen around its axis."""
    mesh: ComposedField | None = None
    """The mesh as the steps have left it; only ``accumulation="incremental"`` has one."""


class _Pass(NamedTuple):
    """A pass of which the landmarks are planned and, as far as they were needed, factored."""

    began: bytes
    plan: LandmarkPlan


class SplineModel(TissueModel):
    """The polyharmonic spline of the paper, equations (1) to (21).

    Each step selects landmarks, gives them the displacement the needle causes (eqs 14 to 21),
    pins the anchors, and solves the spline (eqs 1 to 8). What is factored is kept between steps;
    it makes them fast and changes no bit of them.

    Parameters
    ----------
    tissue : Tissue
        Where the needle goes.
    needle_effect : NeedleTissueModel, optional
        Its effect on the tissue; by default Table I scaled to the grid's side.
    kernel : Kernel, default: Biharmonic()
        The spline's kernel.
    anchors : int or "all", default: 5
        Anchors along each side of a pinned face: 5 x 5 a face are 89 on a cube. They hold
        the faces to a tenth of the peak at worst between them. ``"all"`` pins every node of
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
    build_up : float, default: 0.0
        Depth over which displacements build up from nothing (see :func:`~sonospline.mechanics.built_up`), in the
        unit of the grid. At or above zero, where they are whole at once, as the paper prints them; the registry's
        ``paper`` takes twice the largest of them, so that tissue never moves faster than the needle.
    progress : callable, optional
        Called as ``progress(done, of)`` during the set-up of ``anchors="all"``.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.models.spline import SplineModel
    >>> model = SplineModel(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> response = model.step(model.rest, {"needle": ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5))})
    >>> bool(0.02 < abs(response.field.on_grid()).max() < 0.03)
    True
    """

    name = "paper"

    def __init__(
        self,
        tissue: Tissue,
        needle_effect: NeedleTissueModel | None = None,
        *,
        kernel: Kernel | None = None,
        anchors: int | Literal["all"] = 5,
        max_landmarks: int = 300,
        smoothing: float = 0.0,
        accumulation: Accumulation = "maximum",
        build_up: float = 0.0,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(tissue)
        self.needle_effect = NeedleTissueModel.paper(tissue.grid.side) if needle_effect is None else needle_effect
        self.kernel = Biharmonic() if kernel is None else kernel
        self.smoothing = _validate.number("smoothing", smoothing)
        self.accumulation = _validate.choice("accumulation", accumulation, ("maximum", "incremental"))
        self.build_up = _validate.number("build_up", build_up)
        self.max_landmarks = _validate.count("max_landmarks", max_landmarks)
        self._pins_all_nodes = anchors == "all"
        self._spline = self._anchored_spline(anchors, progress)
        self.anchors = self._spline.points
        self._anchor_nodes = np.rint(tissue.grid.local(self.anchors) / tissue.grid.spacing).astype(np.int64)
        self._undeformed = self._spline.solve(np.zeros_like(self.anchors), grid=tissue.grid)
        self._pass: _Pass | None = None
        self._cache = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_cache"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _cache=threading.Lock())

    @property
    def rest(self) -> SplineState:
        """The state without a needle."""
        return SplineState(self.identity)

    def landmark_count(self, response: Response) -> int:
        """Return how many landmarks a response's needle displaces."""
        field = response.field.steps[-1] if isinstance(response.field, ComposedField) else response.field
        return len(field.centres) - len(self.anchors) if isinstance(field, KernelField) else 0

    def facts(self, response: Response) -> dict[str, Any]:
        """Landmarks and anchors, and the model's parameters."""
        return {
            "landmarks": self.landmark_count(response),
            "anchors": len(self.anchors),
            "accumulation": self.accumulation,
            "build_up_mm": self.build_up,
            "kernel": type(self.kernel).__name__.lower(),
            "model_mm": asdict(self.needle_effect),
        }

    def plan(self, state: State) -> LandmarkPlan | None:
        """Return the landmarks of a state's pass; None while the needle is out."""
        assert isinstance(state, SplineState)
        with self._cache:
            return None if state.began is None else self._plan_of(state.began)

    def _options(self) -> tuple[Any, ...]:
        anchors = "all" if self._pins_all_nodes else len(self.anchors)
        printed = self.needle_effect, self.kernel, anchors, self.max_landmarks, self.smoothing, self.accumulation
        return (*printed, self.build_up)

    def _answer(self, state: State, needles: dict[str, Needle], dt: float) -> Response:
        assert isinstance(state, SplineState)
        if not needles:
            return self._response(self.rest, self._undeformed)
        (needle,), last = needles.values(), next((inside for _, inside in state.needles), None)
        began = state.began if state.began is not None and _same_axis(last, needle) else needle
        new = SplineState(self.identity, tuple(needles.items()), began)
        with self._cache:
            if self.accumulation == "maximum":
                return self._response(new, self._map_reference(needle, began))
            mesh = self._move_mesh(needle, began, last, state.mesh)
            return self._response(replace(new, mesh=mesh), mesh)

    def _response(self, state: SplineState, field: Field) -> Response:
        return Response(state=state, field=field, forces=UnknownForces(self.name))

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

    def _plan_of(self, began: Needle) -> LandmarkPlan:
        """The landmarks of a pass; those of another leave the factor."""
        key = began.entry.tobytes() + began.tip.tobytes()
        if self._pass is None or self._pass.began != key:
            plan = plan_landmarks(self.tissue, began, self.needle_effect, max_landmarks=self.max_landmarks)
            self._pass = None  # whatever fails from here on, the factor belongs to no pass
            self._spline.truncate(len(self.anchors))
            self._pass = _Pass(key, plan)
        return self._pass.plan

    def _map_reference(self, needle: Needle, began: Needle) -> KernelField:
        """One step from the undeformed tissue: only landmarks new to the factor are appended."""
        plan, anchors = self._plan_of(began), len(self.anchors)
        count = plan.active_count(needle.depth)
        if len(self._spline.points) == anchors:
            size = anchors + len(plan.points)
            what = f"max_landmarks = {self.max_landmarks}: the factor of {size:,} landmarks"
            _memory.refuse_beyond(8 * size**2, what, remedy="use fewer landmarks")
            self._spline.reserve(size)
        # With every face node pinned one batch costs as much as all.
        batch = len(plan.points) if self._pins_all_nodes else _BATCH
        while count > (known := len(self._spline.points) - anchors):
            self._spline.append(plan.points[known : known + batch])
        values = np.zeros((anchors + count, 3))
        values[anchors:] = built_up(needle.depth, self.build_up) * plan.history.at(needle.depth, count)
        field = self._spline.solve(values, grid=self.tissue.grid)
        return replace(field, nodes=np.concatenate([self._anchor_nodes, plan.nodes[:count]]))

    def _move_mesh(
        self, needle: Needle, began: Needle, last: Needle | None, mesh: ComposedField | None
    ) -> ComposedField:
        """One step of Algorithm 1 as printed: displace the mesh the last step left."""
        grid = self.tissue.grid
        if last is not None and began is not needle and needle.depth <= last.depth:
            raise ValueError(
                f"tip = {needle.tip.tolist()} does not advance; accumulation='incremental' cannot pull back, "
                "use 'maximum' or reset()"
            )
        before = ComposedField((), grid, grid.points) if mesh is None else mesh
        nodes = np.ravel_multi_index(tuple(self._plan_of(began).nodes.T), grid.shape)
        whole = interaction(before.nodes[nodes], needle, self.needle_effect)
        displacements = built_up(needle.depth, self.build_up) * whole
        moved = displacements.any(axis=1)
        points = np.vstack([self.anchors, before.nodes[nodes][moved]])
        values = np.vstack([np.zeros_like(self.anchors), displacements[moved]])
        step = self._new_spline(points).solve(values, grid=grid)
        return ComposedField((*before.steps, step), grid, step.forward(before.nodes))


def _same_axis(a: Needle | None, b: Needle) -> bool:
    if a is None:
        return False
    apart = np.abs(a.entry - b.entry).max() / max(a.depth, b.depth)
    return bool(max(apart, np.abs(a.direction - b.direction).max()) <= 1e-9)

"""Which nodes carry constraints: anchors on the pinned faces, landmarks around the needle.

Only some of the nodes the needle displaces become landmarks: a coarser lattice of them
and those next to the axis. Measured against finite elements the field is as good with a
few hundred as with all of them, although the two fields differ between landmarks. The choice depends on the
axis alone, and landmarks are ordered by the depth at which they wake: as the needle
advances the active ones grow at the end of the list and never change, which is what an
incremental solver needs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _memory
from ..geometry.grid import Grid, face_slice
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from .interaction import History, NeedleTissueModel

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_CENTRINGS = {"simple": 1.0, "face": 0.5, "body": 0.25}
_SAMPLE = 4_000
_SURELY_TOO_MANY = 2.0
_BYTES_A_SAMPLE = 3000

AXIS_REACH = 0.75
"""Nodes this near to the axis, in spacings, are landmarks before any others."""


def _density(stride: int, centring: str) -> float:
    """Fraction of all nodes on a sub-lattice."""
    return _CENTRINGS[centring] / stride**3


SUB_LATTICES = sorted(
    ((stride, centring) for stride in range(1, 257) for centring in _CENTRINGS),
    key=lambda lattice: -_density(*lattice),
)
"""Strides and centrings, finest first. The centrings fill the gaps between whole strides."""


@dataclass(frozen=True, eq=False)
class LandmarkPlan:
    """Landmarks of one needle axis, over the whole way it could go through the tissue."""

    nodes: Index
    """(m, 3) lattice index of each landmark."""
    points: Array
    """(m, 3) their world positions."""
    history: History
    """What each goes through; those that wake earlier come first."""

    def active_count(self, depth: float) -> int:
        """Return how many landmarks are displaced at a depth: the first ones of the list."""
        return self.history.awake(depth)

    def __repr__(self) -> str:
        return f"LandmarkPlan({len(self.nodes)} landmarks)"


def plan_landmarks(tissue: Tissue, needle: Needle, model: NeedleTissueModel, *, max_landmarks: int) -> LandmarkPlan:
    """Choose at most ``max_landmarks`` nodes around a needle's axis.

    Pinned nodes are never among them. Nodes within 0.75 spacings of the axis come first
    (thinned evenly where they alone exceed half the number), then the finest regular
    sub-lattice that still fits.
    """
    grid = tissue.grid
    near = _thin(_near_axis(tissue, needle, model), max_landmarks // 2)
    reachable = _estimate_reachable(tissue, needle, model)
    for stride, centring in SUB_LATTICES:
        if _density(stride, centring) * reachable > _SURELY_TOO_MANY * max_landmarks:
            continue
        coarse = _movable(tissue, _sub_lattice(grid, needle, stride, centring), needle, model)
        nodes = _once(np.concatenate([near, coarse]), grid.shape)
        if len(nodes) <= max_landmarks:
            break
    points = grid.node(nodes)
    history = History.of(points, needle, model)
    order = np.argsort(history.wakes, kind="stable")
    return LandmarkPlan(nodes[order], points[order], history.select(order))


def select_anchors(tissue: Tissue, per_side: int) -> Array:
    """Return world positions of a ``per_side`` x ``per_side`` set of nodes on each pinned face.

    Nodes shared by two faces count once: 5 x 5 on the five faces of a cube are 89 anchors.
    """
    grid = tissue.grid
    chosen = np.zeros(grid.shape, bool)
    for axis, count in enumerate(grid.shape):
        keep = np.zeros(count, bool)
        keep[np.rint(np.linspace(0, count - 1, min(per_side, count))).astype(int)] = True
        chosen = _outer(chosen, keep, axis)
    faces = np.zeros(grid.shape, bool)
    for face in tissue.pinned_faces:
        faces[face_slice(face)] = chosen[face_slice(face)]
    return grid.node(np.argwhere(faces))


def _outer(mask: NDArray[np.bool_], keep: NDArray[np.bool_], axis: int) -> NDArray[np.bool_]:
    along_axis = keep.reshape([-1 if a == axis else 1 for a in range(3)])
    return (mask if axis else np.ones_like(mask)) & along_axis


def _movable(tissue: Tissue, nodes: Index, needle: Needle, model: NeedleTissueModel) -> Index:
    """Those of the nodes that the needle can displace and no face pins."""
    nodes = nodes[~_pinned(tissue, nodes)]
    return nodes[np.isfinite(History.of(tissue.grid.node(nodes), needle, model).wakes)]


def _pinned(tissue: Tissue, nodes: Index) -> NDArray[np.bool_]:
    last = np.array(tissue.grid.shape) - 1
    on = {"-": nodes == 0, "+": nodes == last}
    masks = [on[face[1]][:, "xyz".index(face[0])] for face in tissue.pinned_faces]
    return np.logical_or.reduce(masks)


def _sub_lattice(grid: Grid, needle: Needle, stride: int, centring: str = "simple") -> Index:
    """Every ``stride``-th node along each axis, one of them next to the entry, thinned by the centring."""
    start = np.rint(grid.local(needle.entry[None])[0] / grid.spacing).astype(int) % stride
    axes = [np.arange(s, n, stride) for s, n in zip(start, grid.shape, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    odd = (nodes - start) // stride % 2
    if centring == "face":
        return nodes[odd.sum(axis=1) % 2 == 0]
    if centring == "body":
        return nodes[(odd == odd[:, :1]).all(axis=1)]
    return nodes


def _estimate_reachable(tissue: Tissue, needle: Needle, model: NeedleTissueModel) -> float:
    """About how many nodes the needle can displace, from a sample: a large grid is never walked."""
    stride = max(1, round((tissue.grid.node_count / _SAMPLE) ** (1 / 3)))
    sample = _movable(tissue, _sub_lattice(tissue.grid, needle, stride), needle, model)
    return len(sample) * float(stride) ** 3


def _near_axis(tissue: Tissue, needle: Needle, model: NeedleTissueModel) -> Index:
    grid = tissue.grid
    spacing = np.array(grid.spacing)
    way, step = np.linalg.norm(grid.extent) + spacing.max(), 0.5 * spacing.min()
    _memory.refuse_beyond(_BYTES_A_SAMPLE * int(way / step), f"grid.spacing = {grid.spacing}: the nodes along an axis")
    samples = np.arange(0, way, step)
    nearest = np.rint(grid.local(needle.entry + samples[:, None] * needle.direction) / spacing)
    around = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
    nodes = (nearest[:, None] + around).reshape(-1, 3).astype(np.int64)
    nodes = nodes[((nodes >= 0) & (nodes < grid.shape)).all(axis=1)]
    nodes = _movable(tissue, _once(nodes, grid.shape), needle, model)
    seen = needle.project(grid.node(nodes))
    close = seen.distance <= AXIS_REACH * spacing.max()
    return nodes[close][np.argsort(seen.along[close], kind="stable")]


def _once(nodes: Index, shape: tuple[int, int, int]) -> Index:
    """Each of the nodes once, in the order of the grid; sorting their numbers is faster than sorting rows."""
    numbers = np.unique(np.ravel_multi_index(tuple(nodes.T), shape))
    return np.stack(np.unravel_index(numbers, shape), axis=-1)


def _thin(nodes: Index, most: int) -> Index:
    if len(nodes) <= most:
        return nodes
    return nodes[np.rint(np.linspace(0, len(nodes) - 1, most)).astype(int)]

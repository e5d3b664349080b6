"""The tissue: a grid of nodes and which of its faces cannot move."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import inside, lengths, shown, size
from .grid import FACES, Grid

Array = NDArray[np.float64]

_PRINTED = 5e-6
"""Of a coordinate's size: what is lost where it is printed."""


@dataclass(frozen=True, repr=False)
class Tissue:
    """A block of tissue whose faces are pinned, all but the one the needle enters (Sec. V) or those one chooses.

    Parameters
    ----------
    grid : Grid
        Its nodes.
    entry_face : str, default: "x-"
        The free face, one of ``sonospline.FACES`` (lattice axis and side).
    pinned_faces : sequence of str, optional
        Faces that do not move, where tissue goes on beyond some of the others or the entry face is held, too; by
        default all five but the entry face.

    Raises
    ------
    ValueError
        A grid that is none, or an unknown face.

    Examples
    --------
    >>> import sonospline as ss
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(25), entry_face="x-")
    >>> int(tissue.pinned.sum()), tissue
    (2929, Tissue(25 x 25 x 25, 0.04167 mm, free face x-))
    >>> ss.Tissue(tissue.grid, "x-", pinned_faces=("x+", "z-", "z+"))
    Tissue(25 x 25 x 25, 0.04167 mm, free faces x-, y-, y+)
    """

    grid: Grid
    entry_face: str = "x-"
    pinned_faces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.grid, Grid):
            raise ValueError(f"grid = {shown(self.grid)} is not a Grid; make one, e.g. Grid.unit_cube(53)")
        _validate.choice("entry_face", self.entry_face, FACES)
        chosen = {_validate.choice("pinned_faces", face, FACES) for face in self.pinned_faces}
        held = chosen or set(FACES) - {self.entry_face}
        object.__setattr__(self, "pinned_faces", tuple(face for face in FACES if face in held))

    def __repr__(self) -> str:
        free = self.free_faces
        said = f"free face{'s' if len(free) > 1 else ''} {', '.join(free)}" if free else "no free face"
        return f"Tissue({size(self.grid.shape)}, {lengths(self.grid.spacing)}, {said})"

    @cached_property
    def free_faces(self) -> tuple[str, ...]:
        """The faces that may move."""
        return tuple(face for face in FACES if face not in self.pinned_faces)

    @cached_property
    def pinned(self) -> NDArray[np.bool_]:
        """Mask shaped like the grid: nodes that do not move, the rims of free faces among them."""
        return self.grid.on_faces(self.pinned_faces)

    def distance_to_pinned(self, points: ArrayLike) -> Array:
        """Return the distance (m,) of world points (m, 3) in the box to the nearest pinned face; a number for one."""
        local = self.grid.local(points)
        from_both = np.stack([local, self.grid.extent - local], axis=-1).reshape(*local.shape[:-1], 6)
        pinned = [face in self.pinned_faces for face in FACES]
        return np.maximum(from_both[..., pinned].min(axis=-1), 0.0)

    def depth_below_entry_face(self, point: ArrayLike) -> float:
        """Return how deep a world point (3,) is below the entry face, at least 0."""
        return float(max(0.0, -self._beyond(np.asarray(point, float))[FACES.index(self.entry_face)]))

    def check_inside(self, **points: ArrayLike) -> None:
        """Raise ValueError for the first of the named world points that lies outside the tissue.

        A point on a face counts as inside however its coordinates were printed: to five
        millionths of their size, which float32 headers and three decimals of a mm keep to.
        """
        for name, given in points.items():
            point = _validate.vector(name, given)
            beyond = self._beyond(point)
            if not beyond.max() <= self._rounding:
                raise ValueError(
                    f"{name} = {point.tolist()} lies outside the tissue, {beyond.max():.3g} beyond its face "
                    f"{FACES[int(beyond.argmax())]}; {self._way_in(point)}"
                )

    def _beyond(self, point: Array) -> Array:
        """How far (6,) a point lies beyond each of :data:`FACES`; below zero where it is inside."""
        beyond, local = np.empty(6), self.grid.local(point)
        beyond[::2], beyond[1::2] = -local, local - self.grid.extent
        return beyond

    @cached_property
    def _rounding(self) -> float:
        """By how much a printed point of a face may lie beyond it."""
        return float(_PRINTED * (self.grid.extent.max() + np.abs(self._corners).max()))

    @property
    def _corners(self) -> Array:
        """(8, 3) in the world."""
        return self.grid.world(np.indices((2, 2, 2)).reshape(3, -1).T * self.grid.extent)

    def _way_in(self, point: Array) -> str:
        if np.abs(self.grid.direction).max(axis=0).min() > 1 - _PRINTED:  # along the world's axes
            low, high = self._corners.min(axis=0).tolist(), self._corners.max(axis=0).tolist()
            ends = (inside(a, b) for a, b in zip(low, high, strict=True))
            return "move it into " + " x ".join(f"[{a}, {b}]" for a, b in ends)
        nearest = self.grid.world(np.clip(self.grid.local(point[None]), 0, self.grid.extent))[0]
        return f"its box is tilted, move it towards the nearest point {np.round(nearest, 4).tolist()}"

    def boundary_drift(self, displacement: NDArray[np.floating]) -> float:
        """Return how far any pinned node moves in a displacement (nx, ny, nz, 3); ideally zero.

        Sampled anchors hold the faces between them only roughly; this says how roughly.
        """
        return float(np.linalg.norm(displacement[self.pinned], axis=-1).max())

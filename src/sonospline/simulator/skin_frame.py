"""Where a command is in the world: needle and probe seen from the skin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry.grid import FACES, Grid
from .command import NeedleCommand, ProbeCommand

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SkinFrame:
    """Directions of a scene (unit vectors, RAS) and the point of the skin under which the probe rests.

    Parameters
    ----------
    right, depth : (3,) ndarray
        r, along the skin, and d, into the tissue.
    origin : (3,) ndarray
        A point of the entry face.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.simulator.skin_frame import SkinFrame
    >>> frame = SkinFrame(np.array([1., 0, 0]), np.array([0, 0, 1.]), np.zeros(3))
    >>> frame.out.tolist()
    [0.0, -1.0, 0.0]
    """

    right: Array
    depth: Array
    origin: Array

    @classmethod
    def on_face(cls, grid: Grid, face: str, *, at: ArrayLike | None, right: ArrayLike | None) -> SkinFrame:
        """Return the frame of a grid's face: below a point (its middle), along a direction (its longer side).

        Raises
        ------
        ValueError
            A direction that is square to the face.
        """
        axis, end = divmod(FACES.index(face), 2)
        depth = grid.direction[:, axis] * (-1.0 if end else 1.0)
        along = _longer_side(grid, axis) if right is None else np.asarray(right, float)
        across = along - (along @ depth) * depth
        if np.linalg.norm(across) < 1e-6 * max(1.0, float(np.linalg.norm(along))):
            raise ValueError(f"right = {along.tolist()} is square to the entry face {face}; give a direction along it")
        local = grid.extent / 2 if at is None else grid.local(np.asarray(at, float)[None])[0]
        local[axis] = grid.extent[axis] if end else 0.0
        return cls(across / np.linalg.norm(across), depth, grid.world(local[None])[0])

    @cached_property
    def out(self) -> Array:
        """n = r x d, away from the viewer of the image."""
        return np.cross(self.right, self.depth)

    def sides(self, grid: Grid) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return how far a grid reaches along r and along n, from the origin, mm."""
        corners = grid.world(np.indices((2, 2, 2)).reshape(3, -1).T * grid.extent) - self.origin
        u, v = corners @ self.right, corners @ self.out
        return (float(u.min()), float(u.max())), (float(v.min()), float(v.max()))

    def entry(self, command: NeedleCommand) -> Array:
        """Return where the needle meets the skin: origin + u r + v n."""
        return self.origin + command.u * self.right + command.v * self.out

    def direction(self, command: NeedleCommand) -> Array:
        """Return the needle's unit vector: cos(swing) (cos(angle) r + sin(angle) d) + sin(swing) n."""
        angle, swing = np.radians(command.angle), np.radians(command.swing)
        in_plane = np.cos(angle) * self.right + np.sin(angle) * self.depth
        return np.cos(swing) * in_plane + np.sin(swing) * self.out

    def probe_to_reference(self, command: ProbeCommand, press_mm: float) -> Array:
        """Return the probe's pose (4, 4): origin in the middle of its face, x right, y deep, z away from the viewer.

        Slide along r and sweep along n; then rotate about d (right-handed), then fan about the image's own x,
        positive turning its depth towards its z.
        """
        turn, fan = np.radians(command.rotate), np.radians(command.fan)
        x = np.cos(turn) * self.right - np.sin(turn) * self.out
        z = np.cos(turn) * self.out + np.sin(turn) * self.right
        y = np.cos(fan) * self.depth + np.sin(fan) * z
        pose = np.eye(4)
        origin = self.origin + press_mm * self.depth + command.slide * self.right + command.sweep * self.out
        pose[:3] = np.column_stack([x, y, np.cos(fan) * z - np.sin(fan) * self.depth, origin])
        return pose

    def parts(self, vector: Array) -> tuple[float, float, float]:
        """Return a vector's parts to the right, deeper, and away from the viewer."""
        return float(vector @ self.right), float(vector @ self.depth), float(vector @ self.out)


def room_along(grid: Grid, entry: Array, direction: Array) -> float:
    """Return how far one can go from a point of the box in a direction before leaving it, mm."""
    start, step = grid.local(entry[None])[0], direction @ grid.direction
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.where(step > 0, (grid.extent - start) / step, np.where(step < 0, -start / step, np.inf))
    return float(max(0.0, ends.min()))


def _longer_side(grid: Grid, axis: int) -> Array:
    """Direction of the longer side of the faces square to an axis, towards right, front or head."""
    side = max((a for a in range(3) if a != axis), key=lambda a: float(grid.extent[a]))
    along = grid.direction[:, side]
    return along * np.sign(along[np.argmax(np.abs(along))])

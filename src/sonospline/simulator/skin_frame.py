"""Where a command is in the world: needle and probe seen from the skin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import pose
from ..geometry.grid import FACES, Grid
from ..geometry.needle import Needle
from .command import NeedleCommand, ProbeCommand

Array = NDArray[np.float64]

_OFF_MM, _OFF_DEG = 1e-3, 1e-3
"""How far from what the numbers can say a pose may be."""


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

    def needle(self, command: NeedleCommand) -> Needle | None:
        """Return the needle in the tissue; None while it is out."""
        if command.depth == 0:
            return None
        entry = self.entry(command)
        return Needle(entry, entry + command.depth * self.direction(command))

    def needle_command(self, needle: Needle) -> NeedleCommand:
        """Return the numbers of a needle; the inverse of :meth:`needle`.

        Raises
        ------
        ValueError
            An entry off the skin, or a needle along n, which has no angle.
        """
        u, off, v = self.parts(needle.entry - self.origin)
        if abs(off) > _OFF_MM:
            where = f"{abs(off):.3g} mm {'below' if off > 0 else 'above'} the skin"
            raise ValueError(f"entry = {needle.entry.tolist()} is {where}; give where the needle crosses it")
        right, deep, away = self.parts(needle.direction)
        if np.hypot(right, deep) < np.sin(np.radians(_OFF_DEG)):
            raise ValueError(f"needle = {needle} is square to the rest image and has no angle; turn it into the tissue")
        angle, swing = np.degrees(np.arctan2(deep, right)), np.degrees(np.arctan2(away, np.hypot(right, deep)))
        return NeedleCommand(u=u, v=v, angle=float(angle), swing=float(swing), depth=needle.depth)

    def probe_to_reference(self, command: ProbeCommand, press_mm: float) -> Array:
        """Return the probe's pose (4, 4): origin in the middle of its face, x right, y deep, z away from the viewer.

        Press along d, beyond what the scene has it; slide along r and sweep along n; then rotate about d
        (right-handed), then fan about the image's own x, positive turning its depth towards its z.
        """
        turn, fan = np.radians(command.rotate), np.radians(command.fan)
        x = np.cos(turn) * self.right - np.sin(turn) * self.out
        z = np.cos(turn) * self.out + np.sin(turn) * self.right
        y = np.cos(fan) * self.depth + np.sin(fan) * z
        place = np.eye(4)
        deep = press_mm + command.press
        origin = self.origin + deep * self.depth + command.slide * self.right + command.sweep * self.out
        place[:3] = np.column_stack([x, y, np.cos(fan) * z - np.sin(fan) * self.depth, origin])
        return place

    def probe_command(self, probe_to_reference: ArrayLike, press_mm: float) -> ProbeCommand:
        """Return the numbers of a probe's pose; the inverse of :meth:`probe_to_reference`.

        Raises
        ------
        ValueError
            A pose that is not rigid, one above where the scene presses it, or one that is rocked: turned
            about its own z, which slide, sweep, rotate and fan do not do.
        """
        place = pose.rigid("probe_to_reference", probe_to_reference)
        slide, deep, sweep = self.parts(place[:3, 3] - self.origin)
        if deep < press_mm - _OFF_MM:
            raise ValueError(
                f"probe_to_reference has its origin {deep:.4g} mm below the skin; place it {press_mm:g} mm below, as "
                "the scene presses it, or deeper"
            )
        press = deep - press_mm if deep > press_mm + _OFF_MM else 0.0
        right, rocked, away = self.parts(place[:3, 0])
        if abs(rocked) > np.sin(np.radians(_OFF_DEG)):
            rock = np.degrees(np.arcsin(np.clip(rocked, -1, 1)))
            raise ValueError(
                f"probe_to_reference is rocked by {rock:.3g} degrees about its z; give an x along the skin, as slide, "
                "sweep, rotate and fan leave it"
            )
        rotate = np.arctan2(-away, right)
        turned = np.cos(rotate) * self.out + np.sin(rotate) * self.right
        fan = np.arctan2(place[:3, 1] @ turned, place[:3, 1] @ self.depth)
        turned_by, fanned_by = float(np.degrees(rotate)), float(np.degrees(fan))
        return ProbeCommand(press=press, slide=slide, sweep=sweep, rotate=turned_by, fan=fanned_by)

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

"""What a step brings to a track: a motion of the needle, and how the tissue answers."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from .track import Track

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """A needle that goes straight from one pose to another."""

    last: Needle
    needle: Needle
    speed: float | None = None
    """Of the tip along the needle, mm/s; None where time is not asked for."""

    @classmethod
    def of(cls, last: Needle, needle: Needle, dt: float) -> Motion:
        """Return the motion from pose to pose in a time."""
        speed = float((needle.tip - last.tip) @ needle.direction) / dt if dt > 0 else None
        return cls(last, needle, speed)

    @property
    def travel(self) -> float:
        """Of the tip, mm."""
        return float(np.linalg.norm(self.needle.tip - self.last.tip))

    def parts(self, count: int) -> list[Motion]:
        """Return the motion in equal parts."""
        poses = [_between(self.last, self.needle, part / count) for part in range(count + 1)]
        return [Motion(begin, end, self.speed) for begin, end in itertools.pairwise(poses)]


class Answer(NamedTuple):
    """How tissue answers to the forces of a track: by w0 to f0, and by a share of its compliance to their change."""

    moved: Array
    """(m, 3) w0, in the world."""
    forces: Array
    """(m, 3) f0."""
    share: float = 1.0
    """Of the compliance: less than one where tissue relaxes."""

    def to(self, track: Track, needle: Needle) -> Array:
        """Return the displacement (m, 3) of the points under the forces that a track has now."""
        changed = (track.forces(needle) - self.forces).ravel()
        result: Array = self.moved + self.share * (track.compliance @ changed).reshape(-1, 3)
        return result

    def __repr__(self) -> str:
        return f"Answer({len(self.moved)} points, share={self.share:.3g})"

    def with_points(self, moved: Array) -> Answer:
        """Return the answer with points more (n, 3), on which no force acted."""
        return self._replace(
            moved=np.vstack([self.moved, moved]), forces=np.vstack([self.forces, np.zeros_like(moved)])
        )


def _between(first: Needle, last: Needle, part: float) -> Needle:
    if part in (0.0, 1.0):
        return last if part else first
    return Needle(first.entry + part * (last.entry - first.entry), first.tip + part * (last.tip - first.tip))

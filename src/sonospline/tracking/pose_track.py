"""The last poses of a tracked tool, and where it will be a moment later."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_KEPT, _LONGEST_S = 5, 0.15
"""Poses that its velocity is taken of: so many, and no older than that before the newest."""
_FURTHEST_S = 0.1
"""How far ahead a pose is guessed at most."""
_OFFSETS = 200
_CLOCK_SET_S = 1.0
"""Where stamps jump by more than that against the arrivals, the sender's clock was set, or it began anew."""


class StampClock:
    """When what carries a sender's stamp was measured, by this machine's clock.

    The quickest of the last messages is taken to have needed no time: its stamp and its arrival join the two clocks.
    """

    def __init__(self) -> None:
        self._offsets: deque[float] = deque(maxlen=_OFFSETS)

    def measured(self, stamp_s: float | None, arrival_s: float) -> float:
        """Return when, s; the arrival where there is no stamp."""
        if not stamp_s:
            return arrival_s
        offset = arrival_s - stamp_s
        if self._offsets and abs(offset - self._offsets[-1]) > _CLOCK_SET_S:
            self._offsets.clear()
        self._offsets.append(offset)
        return stamp_s + min(self._offsets)


class PoseTrack:
    """A tool's poses in the order they were measured.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.tracking import PoseTrack
    >>> track = PoseTrack()
    >>> for number in range(4):
    ...     pose = np.eye(4)
    ...     pose[0, 3] = 2.0 * number
    ...     track.add(pose, 0.02 * number)
    >>> track.newest[0, 3].item(), round(track.at(0.1)[0, 3].item(), 6)
    (6.0, 10.0)
    """

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Array]] = deque(maxlen=_KEPT)

    def add(self, pose: Array, time_s: float) -> None:
        """Take a pose (4, 4), rigid; one that is older than the newest is left out."""
        if self._poses and time_s < self._poses[-1][0]:
            return
        if self._poses and time_s == self._poses[-1][0]:
            self._poses.pop()
        self._poses.append((time_s, pose))

    @property
    def newest(self) -> Array:
        """The newest pose."""
        return self._poses[-1][1]

    def at(self, time_s: float) -> Array:
        """Return the pose at a later time: moved and turned on as it was, for a tenth of a second at most."""
        last, newest = self._poses[-1]
        recent = [(when - last, pose) for when, pose in self._poses if last - when <= _LONGEST_S]
        ahead = min(time_s - last, _FURTHEST_S)
        if ahead <= 0 or len(recent) < 2:
            return newest
        from scipy.spatial.transform import Rotation

        before = np.array([when for when, _ in recent])
        moved = np.array([pose[:3, 3] - newest[:3, 3] for _, pose in recent])
        turned = Rotation.from_matrix([pose[:3, :3] @ newest[:3, :3].T for _, pose in recent]).as_rotvec()
        velocity, spin = (before @ each / (before @ before) for each in (moved, turned))
        guess = np.eye(4)
        guess[:3, :3] = Rotation.from_rotvec(ahead * spin).as_matrix() @ newest[:3, :3]
        guess[:3, 3] = newest[:3, 3] + ahead * velocity
        return guess

    def __repr__(self) -> str:
        return f"PoseTrack({len(self._poses)} poses)"

"""The motion of one tool, measured as PerkTutor measures it, so that scores can be compared.

Names, thresholds and sums are those of its scripts (github.com/PerkTutor/PythonMetrics); a mean of speeds and a jerk by
differences depend on the sampling rate: :mod:`~sonospline.training.smoothness` has what does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .._by_bits import ByBits

Array = NDArray[np.float64]

ACTION_MM_S, ACTION_DEG_S, ACTION_S = 50.0, 50.0, 0.2
"""What PerkTutor takes for an action: faster than that, for longer than that."""
IN_ACTION_MM_S, IN_ACTION_DEG_S = 5.0, 10.0
"""What TrainUS takes for being in action, for as long."""


@dataclass(frozen=True, eq=False, repr=False)
class ToolMotion(ByBits):
    """Poses of a tool over time.

    Parameters
    ----------
    time_s : (n,) array_like
        Seconds, each later than the one before.
    poses : (n, 4, 4) array_like
        Rigid, from the tool to the reference; its origin is what moves.

    Raises
    ------
    ValueError
        Fewer than two samples, times that do not grow, or arrays of other shapes.

    Examples
    --------
    >>> import numpy as np
    >>> poses = np.broadcast_to(np.eye(4), (3, 4, 4)).copy()
    >>> poses[:, 0, 3] = 0, 30, 40
    >>> motion = ToolMotion(np.array([0, 1, 2.0]), poses)
    >>> motion.path_length_mm, motion.average_velocity_mm_s, motion.path_inefficiency_percent
    (40.0, 20.0, 0.0)
    """

    time_s: Array
    poses: Array

    def __post_init__(self) -> None:
        time, poses = np.array(self.time_s, float), np.array(self.poses, float)
        if time.ndim != 1 or len(time) < 2 or not (np.diff(time) > 0).all():
            raise ValueError("time_s does not grow over two samples at least; leave out those that are not later")
        if poses.shape != (len(time), 4, 4):
            raise ValueError(f"poses has shape {poses.shape}; give {(len(time), 4, 4)}, one for each time")
        for name, value in (("time_s", time), ("poses", poses)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def of_needle(cls, time_s: Array, entry: Array, tip: Array) -> ToolMotion:
        """Return the motion of a needle's tip, z along the needle, which does not turn about itself."""
        poses = np.broadcast_to(np.eye(4), (len(tip), 4, 4)).copy()
        poses[:, :3, :3], poses[:, :3, 3] = _turned_to(tip - entry), tip
        return cls(time_s, poses)

    @property
    def places(self) -> Array:
        """(n, 3) of the tool's origin, mm."""
        return self.poses[:, :3, 3]

    @property
    def path_length_mm(self) -> float:
        """Length of the way."""
        return float(self._steps_mm.sum())

    @property
    def path_inefficiency_percent(self) -> float:
        """By how much the way is longer than the straight line from its first place to its last."""
        straight = float(np.linalg.norm(self.places[-1] - self.places[0]))
        return 100 * (self.path_length_mm / straight - 1) if straight > 0 else np.nan

    @property
    def average_velocity_mm_s(self) -> float:
        """Mean of the speeds between samples."""
        return float((self._steps_mm / np.diff(self.time_s)).mean())

    @property
    def motion_smoothness_mm_s3(self) -> float:
        """Root of the integral of the squared jerk, by backward differences."""
        if len(self.time_s) < 4:
            return 0.0
        dt = np.diff(self.time_s)
        velocity = np.diff(self.places, axis=0) / dt[:, None]
        acceleration = np.diff(velocity, axis=0) / dt[1:, None]
        jerk = np.diff(acceleration, axis=0) / dt[2:, None]
        return float(np.sqrt(((jerk**2).sum(axis=1) * dt[2:]).sum()))

    @property
    def rotation_total_deg(self) -> float:
        """Sum of the angles from sample to sample."""
        return float(self._turns_deg.sum())

    @property
    def translational_actions(self) -> int:
        """Spells above 50 mm/s that last longer than 0.2 s."""
        return self._spells(self._frame_speed_mm_s > ACTION_MM_S)

    @property
    def rotational_actions(self) -> int:
        """Spells above 50 degrees a second that last longer than 0.2 s."""
        return self._spells(self._turns_deg / np.diff(self.time_s) > ACTION_DEG_S)

    @property
    def hand_movements(self) -> int:
        """Spells above 5 mm/s or 10 degrees a second that last longer than 0.2 s: TrainUS's thresholds."""
        dt = np.diff(self.time_s)
        return self._spells((self._steps_mm / dt > IN_ACTION_MM_S) | (self._turns_deg / dt > IN_ACTION_DEG_S))

    @property
    def _steps_mm(self) -> Array:
        return np.linalg.norm(np.diff(self.places, axis=0), axis=1)

    @property
    def _turns_deg(self) -> Array:
        rotations = Rotation.from_matrix(self.poses[:, :3, :3])
        return np.degrees((rotations[1:] * rotations[:-1].inv()).magnitude())

    @property
    def _frame_speed_mm_s(self) -> Array:
        """Of the translation in a pose times the one before inverted: a turn about the world's origin has none."""
        turned = self.poses[1:, :3, :3] @ np.swapaxes(self.poses[:-1, :3, :3], 1, 2)
        moved = self.places[1:] - (turned @ self.places[:-1, :, None])[..., 0]
        return np.linalg.norm(moved, axis=1) / np.diff(self.time_s)

    def _spells(self, fast: NDArray[np.bool_]) -> int:
        """How often a state has changed to fast, each change lasting longer than the shortest action.

        As PerkTutor has it, the last sample of a state counts from zero, not from the first time.
        """
        count, acting, last = 0, False, 0.0
        for time, now in zip(self.time_s[1:], fast, strict=True):
            if now == acting:
                last = time
            elif time - last > ACTION_S:
                acting, last, count = bool(now), time, count + int(now)
        return count

    def __repr__(self) -> str:
        return f"ToolMotion({len(self.time_s)} poses, {self.path_length_mm:.4g} mm, {self.rotation_total_deg:.4g} deg)"


def _turned_to(along: Array) -> Array:
    """(n, 3, 3) with z along each, turned from the one before by the least there is."""
    length = np.linalg.norm(along, axis=1, keepdims=True)
    z = np.divide(along, length, out=np.tile([0.0, 0.0, 1.0], (len(along), 1)), where=length > 0)
    across, x = np.empty_like(z), np.eye(3)[np.abs(z[0]).argmin()]
    for place, axis in enumerate(z):
        x = x - (x @ axis) * axis
        across[place] = x = x / np.sqrt(x @ x)
    return np.stack([across, np.cross(z, across), z], axis=2)

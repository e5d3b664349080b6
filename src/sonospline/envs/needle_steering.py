"""Needle steering: turn and push a needle to a target that the needle itself moves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from ..simulator.command import Command
from ..simulator.console_frame import ConsoleFrame
from ..simulator.constraint import MOST_DEG
from ..training.exercise import Exercise
from ..training.hands import probe_above
from .score import Cost
from .training_env import TrainingEnv, missing_share

Array = NDArray[np.float64]

_FARTHEST_MM = 150.0
"""Of the error along the needle and twice that across it: beyond it nothing is farther."""
_ERROR_MM, _DEPTH_MM, _FORCE_N, _ASIDE_MM = 20.0, 50.0, 2.0, 5.0
"""What counts as 1 in an observation."""


class NeedleSteering(TrainingEnv):
    """Push and turn a needle until its tip rests on a target that moves with the tissue.

    The needle begins out of the skin and aims elsewhere; its entry stays. A turn inside is held to a few degrees, as
    in the simulator. The image plane holds the entry and the target's place at rest: a tip that leaves it is blind.

    Parameters
    ----------
    exercise : Exercise, str or Path, default: "needle-steering"
        Tissue, start and target: one of :data:`sonospline.envs.world.OWN`, of
        :data:`~sonospline.training.SHIPPED_EXERCISES`, a TOML file, or an exercise.
    spread_mm : (3,) array_like, default: (10, 4, 4)
        How far from its place the target is drawn, at most: right, deeper, away.
    observe : {"state", "pixels"}, default: "state"
        ``(15,)`` numbers of :attr:`numbers`, or ``{"image": (rows, columns, 1), "hand": (9,)}``: B-mode without
        marks, and what a robot's hand knows, the target's place before the tissue moved included.
    tolerance_mm : float, default: 1.0
        From tip to target, where that then is.
    limit_s : float, default: 20.0
        After which an episode is truncated.
    nodes : int, default: 8000
        Of the solver's grid, about.
    costs : mapping of str to Cost, optional
        What the trainer's metrics take from the score; by default :attr:`costs`.
    render_mode : {"rgb_array"}, optional
        What :meth:`render` makes.

    Raises
    ------
    ValueError
        An unknown exercise or scene, a target out of reach, a number out of range.
    MissingExtraError
        Gymnasium is not installed.

    Notes
    -----
    Action, each -1 to 1: push (12 mm/s), angle in plane and swing (15 degrees/s); a step is 0.1 s.
    Reward: what the errors along and twice across the needle (``final_error_along_mm``, ``final_error_across_mm``, as
    if it ended now) fell by, half of it over 150 mm and half over the last 15; once the tip has been on target for
    three steps the score, 0 to 1. A step's is in [-1, 2], an episode's sum as well.

    Examples
    --------
    >>> from sonospline.envs import NeedleSteering, steer
    >>> env = NeedleSteering()
    >>> observation, info = env.reset(seed=3)
    >>> ended = False
    >>> while not ended:
    ...     observation, reward, solved, late, info = env.step(steer(env))
    ...     ended = solved or late
    >>> info["is_success"], info["distance_mm"] < 1.0, info["target_moved_mm"] > 1.0, 0 < reward < 2
    (True, True, True, True)
    """

    costs: ClassVar[Mapping[str, Cost]] = {
        "blind_advance_mm": Cost(0.2, 20.0), "tissue_swept_mm2": Cost(0.2, 300.0), "redirections": Cost(0.1, 3.0),
        "time_s": Cost(0.1, 20.0), "final_error_mm": Cost(0.1, 1.0),
    }  # fmt: skip
    numbers: ClassVar[tuple[str, ...]] = (
        "target ahead", "target up", "target aside", "rest ahead", "rest up", "rest aside", "needle right",
        "needle deep", "needle out", "depth", "turned in plane", "turned out of plane", "axial force", "out of plane",
        "time left",
    )  # fmt: skip
    by_hand: ClassVar[tuple[str, ...]] = (
        "rest ahead", "rest up", "rest aside", "needle deep", "depth", "turned in plane", "turned out of plane",
        "axial force", "time left",
    )  # fmt: skip
    rates: ClassVar[Mapping[str, float]] = {"push": 12.0, "angle": 15.0, "swing": 15.0}

    def __init__(
        self,
        exercise: Exercise | str | Path = "needle-steering",
        *,
        spread_mm: ArrayLike = (10.0, 4.0, 4.0),
        observe: str = "state",
        tolerance_mm: float = 1.0,
        limit_s: float = 20.0,
        nodes: int = 8000,
        costs: Mapping[str, Cost] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.tolerance_mm = _validate.number("tolerance_mm", tolerance_mm, positive=True)
        super().__init__(
            exercise, spread_mm=spread_mm, observe=observe, limit_s=limit_s, nodes=nodes, costs=costs,
            render_mode=render_mode,
        )  # fmt: skip

    def _begin(self, rng: np.random.Generator) -> None:
        episode = self.episode
        frame = episode.frame
        episode.step(probe_above(episode.scene, episode.command, frame.entry, frame.target_rest))

    def _moved(self, command: Command, by: Array) -> Command:
        push, angle, swing = by.tolist()
        needle = command.needle
        return command.with_needle(
            depth=self._within("needle.depth", needle.depth + push),
            angle=self._within("needle.angle", needle.angle + angle),
            swing=self._within("needle.swing", needle.swing + swing),
        )

    def _values(self) -> list[float]:
        frame, skin = self.episode.frame, self.world.scene.frame
        axes = needle_axes(frame, skin.right, skin.depth, skin.out)
        now, rest = (axes @ (place - frame.tip) / _ERROR_MM for place in (frame.target_now, frame.target_rest))
        needle, entered = frame.command.needle, self.episode.entered
        turned = (0.0, 0.0) if entered is None else (needle.angle - entered.angle, needle.swing - entered.swing)
        axial = 0.0 if frame.readouts.hub is None else frame.readouts.hub.axial_n
        return [
            *now.tolist(), *rest.tolist(), *skin.parts(frame.direction), needle.depth / _DEPTH_MM,
            *(angle / MOST_DEG for angle in turned), axial / _FORCE_N, frame.readouts.out_of_plane / _ASIDE_MM,
            self.time_left,
        ]  # fmt: skip

    def _far(self) -> float:
        frame = self.episode.frame
        missing = frame.target_now - frame.tip
        along = float(missing @ frame.direction)
        across = float(np.linalg.norm(missing - along * frame.direction))
        return missing_share(abs(along) + 2 * across, _FARTHEST_MM)

    def _reached(self) -> bool:
        frame = self.episode.frame
        return frame.needle is not None and frame.readouts.tip_to_target <= self.tolerance_mm


def needle_axes(frame: ConsoleFrame, right: Array, depth: Array, out: Array) -> Array:
    """(3, 3) unit rows: along the needle, and where its tip goes by a turn in plane and by a swing."""
    angle, swing = np.radians(frame.command.needle.angle), np.radians(frame.command.needle.swing)
    in_plane = np.cos(angle) * right + np.sin(angle) * depth
    turn = np.cos(angle) * depth - np.sin(angle) * right
    return np.stack([frame.direction, turn, np.cos(swing) * out - np.sin(swing) * in_plane])

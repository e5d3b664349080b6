"""Probe navigation: bring a needle's tip and its target into one image."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from ..geometry.needle import Needle
from ..simulator.command import Command
from ..training.exercise import Exercise
from .score import Cost
from .training_env import TrainingEnv, missing_share

Array = NDArray[np.float64]

_FARTHEST_MM = 100.0
"""Of what tip and target are out of plane, and the target beside the middle: beyond it nothing is farther."""
_PLACE_MM, _SLICE_MM, _SLIDE_MM, _ROTATE_DEG, _FAN_DEG = 20.0, 2.0, 50.0, 90.0, 30.0
"""What counts as 1 in an observation."""
_SHARES = (0.45, 0.75)
"""Of the way to the target, that the needle is in."""


class ProbeNavigation(TrainingEnv):
    """Slide, sweep, rotate and fan a probe until a needle's tip and the target lie in its image.

    The needle is part of the way in and stays: what it has moved, the target too, is where it is now.

    Parameters
    ----------
    exercise : Exercise, str or Path, default: "probe-navigation"
        As for :class:`NeedleSteering`.
    spread_mm : (3,) array_like, default: (10, 4, 4)
        How far from its place the target is drawn, at most: right, deeper, away.
    observe : {"state", "pixels"}, default: "state"
        ``(16,)`` numbers of :attr:`numbers`, or ``{"image": (rows, columns, 1), "hand": (5,)}``: B-mode without
        marks, and the probe's own knobs.
    middle_mm : float, default: 10.0
        How far the target may be beside the middle of the image.
    limit_s, nodes, costs, render_mode
        As for :class:`NeedleSteering`.

    Raises
    ------
    ValueError
        An unknown exercise or scene, a target out of reach, a number out of range.
    MissingExtraError
        Gymnasium is not installed.

    Notes
    -----
    Action, each -1 to 1: slide and sweep (20 mm/s), rotate and fan (25 degrees/s); a step is 0.1 s.
    Reward: what the distances of tip and target from the plane, and of the target from the middle of the image where
    that is too far, fell by, half of it over 100 mm and half over the last 10; once both have been within half the
    slice's thickness for three steps the score, 0 to 1. A step's is in [-1, 2], an episode's sum as well.

    Examples
    --------
    >>> from sonospline.envs import ProbeNavigation, navigate
    >>> env = ProbeNavigation(render_mode="rgb_array")
    >>> observation, info = env.reset(seed=1)
    >>> ended = False
    >>> while not ended:
    ...     observation, reward, solved, late, info = env.step(navigate(env))
    ...     ended = solved or late
    >>> info["is_success"], observation.shape, env.render().shape[2]
    (True, (16,), 3)
    """

    costs: ClassVar[Mapping[str, Cost]] = {
        "probe_path_mm": Cost(0.2, 150.0), "probe_turning_deg": Cost(0.2, 150.0), "time_s": Cost(0.2, 20.0),
    }  # fmt: skip
    numbers: ClassVar[tuple[str, ...]] = (
        "target right", "target deep", "target out", "tip right", "tip deep", "tip out", "entry right", "entry deep",
        "entry out", "half slice at target", "half slice at tip", "slide", "sweep", "rotate", "fan", "time left",
    )  # fmt: skip
    by_hand: ClassVar[tuple[str, ...]] = ("slide", "sweep", "rotate", "fan", "time left")
    rates: ClassVar[Mapping[str, float]] = {"slide": 20.0, "sweep": 20.0, "rotate": 25.0, "fan": 25.0}

    def __init__(
        self,
        exercise: Exercise | str | Path = "probe-navigation",
        *,
        spread_mm: ArrayLike = (10.0, 4.0, 4.0),
        observe: str = "state",
        middle_mm: float = 10.0,
        limit_s: float = 20.0,
        nodes: int = 8000,
        costs: Mapping[str, Cost] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.middle_mm = _validate.number("middle_mm", middle_mm, positive=True)
        super().__init__(
            exercise, spread_mm=spread_mm, observe=observe, limit_s=limit_s, nodes=nodes, costs=costs,
            render_mode=render_mode,
        )  # fmt: skip

    def _begin(self, rng: np.random.Generator) -> None:
        episode, skin = self.episode, self.world.scene.frame
        frame = episode.frame
        aimed = skin.needle_command(Needle(frame.entry, frame.target_rest))
        depth = aimed.depth * float(rng.uniform(*_SHARES))
        episode.settle(
            episode.command.with_needle(
                depth=depth, angle=self._within("needle.angle", aimed.angle),
                swing=self._within("needle.swing", aimed.swing),
            )
        )  # fmt: skip

    def _moved(self, command: Command, by: Array) -> Command:
        probe = command.probe
        return command.with_probe(
            **{
                knob: self._within(f"probe.{knob}", getattr(probe, knob) + change)
                for knob, change in zip(self.rates, by.tolist(), strict=True)
            }
        )

    def _values(self) -> list[float]:
        frame = self.episode.frame
        places = np.stack([frame.target_now, frame.tip, frame.entry])
        pose, probe = frame.probe_to_reference, frame.command.probe
        seen = (places - pose[:3, 3]) @ pose[:3, :3] / _PLACE_MM
        slices = (frame.out_of_plane(place)[1] / _SLICE_MM for place in places[:2])
        return [
            *seen.ravel().tolist(), *slices, probe.slide / _SLIDE_MM, probe.sweep / _SLIDE_MM,
            probe.rotate / _ROTATE_DEG, probe.fan / _FAN_DEG, self.time_left,
        ]  # fmt: skip

    def _far(self) -> float:
        frame = self.episode.frame
        away = sum(abs(frame.out_of_plane(place)[0]) for place in (frame.target_now, frame.tip))
        return missing_share(away + max(0.0, self._beside_middle - self.middle_mm), _FARTHEST_MM)

    def _reached(self) -> bool:
        frame = self.episode.frame
        seen = (frame.out_of_plane(place) for place in (frame.target_now, frame.tip))
        return self._beside_middle <= self.middle_mm and all(abs(away) <= half for away, half in seen)

    @property
    def _beside_middle(self) -> float:
        frame = self.episode.frame
        pose = frame.probe_to_reference
        return abs(float((frame.target_now - pose[:3, 3]) @ pose[:3, 0]))

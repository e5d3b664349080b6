"""What the environments have in common: an episode of an exercise, steps of equal time, a goal to hold, a reward."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._extras import present, require
from .._shown import shown
from ..simulator.command import Command
from ..training.exercise import Exercise
from ..ultrasound.optics import picture_plane
from .overlay import Painter
from .score import Cost, check_costs, score
from .world import Episode, World

if TYPE_CHECKING or present("gymnasium"):
    from gymnasium import Env, spaces
else:
    Env = object  # importing it needs no extra; making one does

Array = NDArray[np.float64]

STEP_S = 0.1
"""Seconds of a step."""
HOLD = 3
"""Steps for which the goal has to be held."""
BOUND = 10.0
"""Of every number of an observation: what is beyond it counts as that."""
SMALL_PIXELS, LARGE_PIXELS = 128, 512
"""Along the longer side of what is observed, and of what people look at."""


class TrainingEnv(Env):
    """An exercise as an environment; see :class:`NeedleSteering` and :class:`ProbeNavigation`."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": round(1 / STEP_S)}
    costs: ClassVar[Mapping[str, Cost]]
    """By default."""
    numbers: ClassVar[tuple[str, ...]]
    """What an observation's numbers are, in order."""
    by_hand: ClassVar[tuple[str, ...]]
    """Those of them that a hand knows without any picture."""
    rates: ClassVar[Mapping[str, float]]
    """What an action moves, in order, and how fast at most, mm or degrees a second."""

    def __init__(
        self,
        exercise: Exercise | str | Path,
        *,
        spread_mm: ArrayLike,
        observe: str,
        limit_s: float,
        nodes: int,
        costs: Mapping[str, Cost] | None,
        render_mode: str | None,
    ) -> None:
        require("gymnasium")
        if render_mode is not None:
            _validate.choice("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.observe = _validate.choice("observe", observe, ("state", "pixels"))
        self._most_steps = max(1, round(_validate.number("limit_s", limit_s, positive=True) / STEP_S))
        self._costs = check_costs(self.costs if costs is None else costs)
        pixels = SMALL_PIXELS if observe == "pixels" else None
        self.world = World(exercise, spread_mm=spread_mm, nodes=nodes, pixels=pixels)
        self._painter = Painter(self.world.seen, LARGE_PIXELS)
        self._travels = {knob.id: (knob.low, knob.high) for knob in self.world.scene.knobs}
        self.step_sizes = np.array([STEP_S * rate for rate in self.rates.values()])
        """What an action of 1 moves, mm or degrees, in the order of :attr:`rates`."""
        self.action_space = spaces.Box(-1.0, 1.0, (len(self.rates),), np.float32)
        self.observation_space = self._observed()
        self.observation: Any = None
        """What the last step or reset let the agent observe."""
        self._episode: Episode | None = None
        self._steps = self._held = 0
        self._ended = False

    @property
    def episode(self) -> Episode:
        """The episode in force."""
        if self._episode is None:
            raise ValueError("the environment has no episode yet; reset() it")
        return self._episode

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Of this episode and all later ones; without it the next one of the last seed.
        options : mapping, optional
            ``{"target_mm": (x, y, z)}``: where the target is at rest, world RAS, instead of a place that is drawn.

        Raises
        ------
        ValueError
            An option that is not known, or a target outside the tissue or out of the needle's reach.
        """
        options = {} if options is None else dict(options)
        for name in options:
            _validate.choice("options", name, ("target_mm",))
        super().reset(seed=seed)
        drawn_by = int(self.np_random.integers(2**63 - 1))
        self._episode = self.world.episode(drawn_by, target=options.get("target_mm"))
        self._begin(np.random.default_rng(drawn_by))
        self._steps = self._held = 0
        self._ended = False
        self._missing = self._far()
        self.observation = self._observed_now()
        return self.observation, self._info()

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move the hand for a tenth of a second; numbers beyond 1 count as 1.

        Raises
        ------
        ValueError
            An action of another shape, or with NaN or infinity in it; an episode that has ended: nothing changes.
        """
        episode, wanted = self.episode, self._checked(action)
        if self._ended:
            raise ValueError("the episode has ended; reset() the environment")
        episode.step(self._moved(episode.command, wanted * self.step_sizes), STEP_S)
        self._steps += 1
        self._held = self._held + 1 if self._reached() else 0
        before, self._missing = self._missing, self._far()
        reward = before - self._missing
        solved, failed = self._held >= HOLD, episode.frame.metrics.passes > episode.exercise.most_passes
        late = self._steps >= self._most_steps and not (solved or failed)
        self._ended = solved or failed or late
        info = self._info()
        if self._ended:
            info |= {"is_success": solved, "metrics": episode.metrics()}
            reward += score(info["metrics"], self._costs) if solved else 0.0
        self.observation = self._observed_now()
        return self.observation, float(reward), bool(solved or failed), late, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return the B-mode image with target and needle drawn on it, (rows, columns, 3); None without a mode."""
        if self.render_mode is None:
            return None
        return self._painter.paint(self.episode.frame)

    def _checked(self, action: ArrayLike) -> Array:
        try:
            wanted = np.asarray(action, float)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"action = {shown(action)} is not numeric; give {len(self.rates)} numbers") from None
        if wanted.shape != (len(self.rates),):
            raise ValueError(
                f"action has shape {wanted.shape}; give {len(self.rates)} numbers: {', '.join(self.rates)}"
            )
        if not np.isfinite(wanted).all():
            raise ValueError(f"action = {wanted.tolist()} contains NaN or infinity; give numbers from -1 to 1")
        return np.clip(wanted, -1.0, 1.0)

    def _observed(self) -> Any:
        """The space of observations."""
        if self.observe == "state":
            return _numbers(len(self.numbers))
        rows, columns = self._picture_shape()
        image = spaces.Box(0, 255, (rows, columns, 1), np.uint8)
        return spaces.Dict({"hand": _numbers(len(self.by_hand)), "image": image})

    @property
    def state(self) -> NDArray[np.float32]:
        """All of :attr:`numbers` as they are now, whatever is observed."""
        return np.clip(np.array(self._values(), np.float32), -BOUND, BOUND)

    def _observed_now(self) -> Any:
        state = self.state
        if self.observe == "state":
            return state
        return {
            "hand": state[[self.numbers.index(name) for name in self.by_hand]],
            "image": self.episode.frame.image.pixels[..., None].copy(),
        }

    def _picture_shape(self) -> tuple[int, int]:
        return picture_plane(self.world.scene.probe, np.eye(4), None, SMALL_PIXELS).shape

    def _info(self) -> dict[str, Any]:
        frame = self.episode.frame
        return {
            "distance_mm": frame.readouts.tip_to_target, "target_moved_mm": frame.readouts.moved,
            "time_s": frame.time_s, "blocked": frame.blocked or "",
        }  # fmt: skip

    @property
    def time_left(self) -> float:
        """Share of the episode's steps that are left."""
        return 1 - self._steps / self._most_steps

    def _within(self, knob: str, value: float) -> float:
        """A knob's value as far as the scene lets it go."""
        low, high = self._travels[knob]
        return min(max(value, low), high)

    @abstractmethod
    def _begin(self, rng: np.random.Generator) -> None:
        """Bring an episode from the exercise's start to the environment's own."""

    @abstractmethod
    def _moved(self, command: Command, by: Array) -> Command:
        """Return a command with what actions move moved by mm or degrees."""

    @abstractmethod
    def _values(self) -> list[float]:
        """Return the numbers of an observation, in the order of :attr:`numbers`."""

    @abstractmethod
    def _far(self) -> float:
        """Return how far from the goal the frame in force is, from 0 to 1."""

    @abstractmethod
    def _reached(self) -> bool:
        """Return whether the frame in force is at the goal."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.world.exercise.name!r}, observe={self.observe!r})"


def missing_share(error_mm: float, far_mm: float) -> float:
    """Return how far from a goal an error is, 0 to 1: half of it over the whole way, half over the last tenth."""
    return 0.5 * min(1.0, error_mm / far_mm) + 0.5 * min(1.0, 10 * error_mm / far_mm)


def _numbers(count: int) -> Any:
    return spaces.Box(-BOUND, BOUND, (count,), np.float32)

"""An attempt at an exercise: from the briefing to the debrief."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from ..simulator.command import Command
from ..simulator.console import Console
from ..simulator.console_frame import ConsoleFrame
from ..simulator.scene import Scene
from ..simulator.session import Session
from .exercise import Exercise, MarkPart
from .growing_trace import GrowingTrace
from .metric import METRICS, measure
from .trace import Sample, Trace

State = Literal["briefing", "running", "debrief"]
Ended = Literal["on target", "given up", "time is up", "too many passes"]
OnFrame = Callable[[ConsoleFrame], object]


@dataclass(frozen=True)
class Judged:
    """One mark of an exercise, and what was reached of it."""

    metric: str
    value: float
    mark: MarkPart

    @property
    def passed(self) -> bool:
        """Whether it is enough; what is not known is not."""
        least, most = self.mark.least, self.mark.most
        return (least is None or self.value >= least) and (most is None or self.value <= most)

    def __str__(self) -> str:
        unit, least, most = METRICS[self.metric].unit, self.mark.least, self.mark.most
        wanted = " and ".join(
            f"{word} {limit:g}" for word, limit in (("at least", least), ("at most", most)) if limit is not None
        )
        value = "unknown" if np.isnan(self.value) else f"{self.value:.3g}"
        return f"{self.metric} is {value}{' ' + unit if unit else ''}, wanted {wanted}"


@dataclass(frozen=True, eq=False)
class Result:
    """What an attempt came to."""

    exercise: Exercise
    seed: int
    ended: Ended
    trace: Trace
    metrics: dict[str, float]
    marks: tuple[Judged, ...]

    @property
    def passed(self) -> bool:
        """Whether the trainee said to be on target, and every mark was reached."""
        return self.ended == "on target" and all(mark.passed for mark in self.marks)

    @property
    def verdict(self) -> str:
        """In words: passed, or what is missing."""
        missing = [str(mark) for mark in self.marks if not mark.passed]
        if self.ended != "on target":
            missing.insert(0, self.ended)
        return f"not yet: {'; '.join(missing)}" if missing else "passed"

    def __repr__(self) -> str:
        return f"Result({self.exercise.name!r}, {self.ended}, {'passed' if self.passed else 'not yet'})"


class Attempt:
    """One attempt at an exercise, worked by commands as the page sends them.

    Parameters
    ----------
    exercise : Exercise
        What is to be done.
    scene : Scene
        Made of the exercise's :meth:`~Exercise.scene_file`; attempts share it.
    seed : int, default: 0
        Of the start: the same one is the same start.
    on_frame : callable, optional
        Is given every frame: a recorder's ``add``, a page.

    Examples
    --------
    >>> from sonospline.simulator import make_scene
    >>> from sonospline.training import Attempt, Exercise
    >>> exercise = Exercise.shipped("vessel-in-plane")
    >>> attempt = Attempt(exercise, make_scene(exercise.scene_file()), seed=1)
    >>> attempt.begin()
    >>> for depth in range(1, 60):
    ...     frame = attempt.step(attempt.command.with_needle(depth=float(depth)), dt=0.1)
    >>> result = attempt.say_on_target()
    >>> attempt.state, result.passed, result.verdict.startswith("not yet: ")
    ('debrief', False, True)
    """

    def __init__(self, exercise: Exercise, scene: Scene, *, seed: int = 0, on_frame: OnFrame | None = None) -> None:
        self.exercise, self.scene, self.seed = exercise, scene, seed
        self.state: State = "briefing"
        self.result: Result | None = None
        """What it came to, from the debrief on."""
        self.start = exercise.start_in(scene, seed)
        """Where the needle and the probe begin."""
        self.console = Console(Session(scene, model=exercise.model))
        """What the attempt is worked on; step it by the attempt alone."""
        self.console.session.choose_target(exercise.target)
        self._on_frame = on_frame
        self.last: ConsoleFrame | None = None
        """The frame in force, from the beginning on."""
        self._growing = GrowingTrace()

    @property
    def command(self) -> Command:
        """The command in force."""
        return self.start if self.last is None else self.console.command

    @property
    def frame(self) -> ConsoleFrame:
        """The frame in force."""
        if self.last is None:
            raise ValueError("the attempt has no frame yet; begin() it")
        return self.last

    def begin(self) -> None:
        """Go from the briefing to the exercise: the clock runs."""
        self._check("briefing")
        self.state = "running"
        self._step(self.start, 0.0)

    def step(self, command: Command | None = None, dt: float = 0.0) -> ConsoleFrame:
        """Bring the tissue to a command; the attempt ends where its time or its passes do.

        Raises
        ------
        ValueError
            The attempt does not run, or the command is beyond the scene or not part of the exercise: nothing changes.
        """
        self._check("running")
        command = self.command if command is None else command
        if command.tissue is None:
            command = msgspec.structs.replace(command, tissue=self.command.tissue)
        self.check(command)
        frame = self._step(command, dt)
        if frame.metrics.passes > self.exercise.most_passes:
            self._end("too many passes")
        elif frame.time_s >= self.exercise.time_limit_s:
            self._end("time is up")
        return frame

    def check(self, command: Command) -> None:
        """Raise ValueError where a command is not part of the exercise: beside the entry zone, in other tissue."""
        zone, needle = self.exercise.entry_zone, command.needle
        if zone is not None and needle.depth > 0:
            for knob, (low, high) in (("u", zone.u), ("v", zone.v)):
                at = getattr(needle, knob)
                if not low <= at <= high:
                    raise ValueError(
                        f"needle.{knob} = {at:g} is beside the entry zone; enter at {low:g} to {high:g} mm"
                    )
        wanted, asked = self.exercise.tissue, command.tissue
        if asked is None:
            return
        for name in wanted.__struct_fields__:
            want, ask = getattr(wanted, name), getattr(asked, name)
            held = name == "breathing" and want != "none" and ask != "none"
            if ask != want and not held:
                raise ValueError(f"tissue.{name} = {ask!r} is not part of the exercise; it stays {want!r}")

    def say_on_target(self) -> Result:
        """End it because the trainee says that the needle is on target."""
        self._check("running")
        return self._end("on target")

    def give_up(self) -> Result:
        """End it because the trainee gives up."""
        self._check("running")
        return self._end("given up")

    def _step(self, command: Command, dt: float) -> ConsoleFrame:
        before = self.last
        self.last = frame = self.console.step(command, dt)
        if before is not None and before.number == frame.number:  # frozen: nothing has happened
            return frame
        self._growing.add(frame.time_s, Sample.of(frame, self.scene))
        if self._on_frame is not None:
            self._on_frame(frame)
        return frame

    def _check(self, state: State) -> None:
        if self.state != state:
            raise ValueError(f"the attempt is in its {self.state}, not {state}; make another Attempt to try again")

    def _end(self, how: Ended) -> Result:
        if len(self._growing) < 2:
            raise ValueError("no time has passed in the attempt; give step() a dt")
        trace = self._growing.trace()
        metrics = measure(trace, self.exercise.task)
        marks = tuple(Judged(name, metrics[name], mark) for name, mark in self.exercise.pass_mark.items())
        self.state = "debrief"
        self.result = Result(self.exercise, self.seed, how, trace, metrics, marks)
        return self.result

"""An attempt at an exercise as a page works on it: nothing but what is part of the exercise, and written down."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..training.attempt import Attempt
from ..training.attempt_recording import AttemptRecording
from ..training.exercise import Exercise
from ..training.guide import Guide
from ..training.pass_meter import PassMeter
from .wire import PassSummary

if TYPE_CHECKING:
    from ..simulator.command import Command
    from ..simulator.console import Console
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.scene import Scene


class LiveAttempt:
    """An attempt that runs; made in any thread, stepped in one.

    Parameters
    ----------
    id : str
        Of the exercise, as pages know it.
    exercise, scene, seed
        Of the attempt.
    recording : AttemptRecording
        Where it is written down.
    """

    def __init__(self, id: str, exercise: Exercise, scene: Scene, seed: int, recording: AttemptRecording) -> None:
        self.exercise, self.recording = id, recording
        self.guides: frozenset[Guide] = frozenset(exercise.guides)
        """What may be shown beside the image."""
        self.commands: list[Command] = []
        """Of each frame that was written down, in order."""
        self.events: list[tuple[float, str]] = []
        """What happened, with the session's time."""
        self.on_end: Callable[[], Any] = lambda: None
        """Called in the stepping thread when the attempt is over."""
        self.on_result: Callable[[LiveAttempt], Any] | None = None
        """Called as it ends in any way; one that is left counts as given up."""
        self._heard = 0
        self._meter = PassMeter()
        self.attempt = Attempt(exercise, scene, seed=seed, on_frame=self._take)
        recording.begin(self.attempt)
        try:
            self.attempt.begin()
        except BaseException:
            recording.close()
            raise

    @property
    def console(self) -> Console:
        """What it is worked on."""
        return self.attempt.console

    @property
    def scene(self) -> Scene:
        """The console's."""
        return self.console.scene

    @property
    def command(self) -> Command:
        """The command in force."""
        return self.attempt.command

    @property
    def start(self) -> Command:
        """Where it began."""
        return self.attempt.start

    @property
    def last(self) -> ConsoleFrame:
        """The frame in force."""
        return self.attempt.frame

    @property
    def over(self) -> bool:
        """Whether it has come to its debrief."""
        return self.attempt.state == "debrief"

    def step(self, command: Command | None = None, dt: float = 0.0) -> ConsoleFrame:
        """Come to a command, some time later; nothing moves once it is over."""
        if self.over:
            return self.last
        frame = self.attempt.step(command, dt)
        if self.attempt.result is not None:
            self._end()
        return frame

    def check(self, command: Command) -> None:
        """Raise ValueError where a command is beyond the scene's limits, or not part of the exercise."""
        self.console.scene.check(command)
        self.attempt.check(command)

    def say_on_target(self) -> None:
        """End it because the trainee says that the needle is on target."""
        self._finish(self.attempt.say_on_target)

    def give_up(self) -> None:
        """End it because the trainee gives up."""
        self._finish(self.attempt.give_up)

    def summary(self, frame: ConsoleFrame) -> PassSummary:
        """Return what a page says of the attempt; numbers of the tip only where these may be shown."""
        if "numbers" in self.guides:
            return self.measured(frame)
        return PassSummary(time_s=frame.time_s, passes=frame.metrics.passes, path_mm=None, blind_mm=None)

    def measured(self, frame: ConsoleFrame) -> PassSummary:
        """Return all that is known of the attempt."""
        path, blind = self._meter.found(frame.time_s)
        return PassSummary(time_s=frame.time_s, passes=frame.metrics.passes, path_mm=path, blind_mm=blind)

    def pause(self) -> None:
        """Let nothing happen until the next step."""
        self.console.pause()

    def close(self) -> None:
        """End it and what is written down; nobody goes on with it."""
        if self.on_result is not None and not self.over:
            with contextlib.suppress(ValueError):  # nothing has happened in it
                self.attempt.give_up()
                self._end()
        self.recording.close()

    def _finish(self, say: Callable[[], object]) -> None:
        if not self.over:
            say()
            self._end()

    def _end(self) -> None:
        self.recording.close()
        if self.on_result is not None:
            self.on_result(self)
        self.on_end()

    def _take(self, frame: ConsoleFrame) -> None:
        self.recording.add(frame)
        self.commands.append(frame.command)
        self._meter.add(frame)
        for event in frame.log:
            if event.number > self._heard:
                self.events.append((frame.time_s, event.text))
        self._heard = max(self._heard, frame.log[-1].number if frame.log else 0)

"""Free practice: a console, and what its present pass looks like."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..training.growing_trace import GrowingTrace
from ..training.guide import ALL_GUIDES
from ..training.metric import METRICS
from ..training.task import Task
from ..training.trace import Sample
from .wire import PassSummary

if TYPE_CHECKING:
    from ..geometry.needle import Needle
    from ..simulator.command import Command
    from ..simulator.console import Console
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.scene import Scene
    from ..simulator.session import Session
    from ..training.guide import Guide

MEASURED_EVERY_S = 0.5
"""Of the session's time, between two looks at the whole pass."""
_STILL_MM = 0.01
"""A needle that moves by less rests."""
_NOTHING = Task()


class PassMeter:
    """Measures the present pass, or the last one, as it goes on."""

    def __init__(self) -> None:
        self._growing = GrowingTrace()
        self._passes = -1
        self._measured_at = -1.0
        self._last: Needle | None = None
        self._found: tuple[float | None, float | None] = (None, None)

    def add(self, frame: ConsoleFrame) -> None:
        """Take a frame; what comes while the needle is out belongs to no pass."""
        if frame.metrics.passes != self._passes:
            self._passes, self._found, self._measured_at = frame.metrics.passes, (None, None), -1.0
            self._growing.clear()
        if frame.needle is not None and self._has_moved(frame.needle):
            self._growing.add(frame.time_s, Sample.of(frame, None))

    def _has_moved(self, needle: Needle) -> bool:
        """A needle that rests in tissue that breathes has frames without end, and none of them tells anything."""
        last, self._last = self._last, needle
        if last is not None and len(self._growing) and _apart(last, needle) < _STILL_MM:
            self._last = last
            return False
        return True

    def found(self, now_s: float) -> tuple[float | None, float | None]:
        """Return path and blind advance of the tip, mm; None before a pass has two samples."""
        if len(self._growing) > 1 and now_s - self._measured_at >= MEASURED_EVERY_S:
            self._measured_at, trace = now_s, self._growing.trace()
            path, blind = (METRICS[name].of(trace, _NOTHING) for name in ("needle_path_mm", "blind_advance_mm"))
            self._found = float(path), float(blind)
        return self._found


def _apart(one: Needle, other: Needle) -> float:
    """How far ends of two needles are apart at most, mm."""
    ends = zip((one.entry, one.tip), (other.entry, other.tip), strict=True)
    return max(float(np.abs(a - b).max()) for a, b in ends)


class Practice:
    """A console that nothing is asked of.

    Parameters
    ----------
    console : Console
        Its own from now on.
    """

    exercise = None
    over = False

    def __init__(self, console: Console) -> None:
        self.guides: frozenset[Guide] = ALL_GUIDES
        """What may be shown beside the image."""
        self.console = console
        self._meter = PassMeter()

    @property
    def scene(self) -> Scene:
        """The console's."""
        return self.console.scene

    @property
    def session(self) -> Session:
        """The console's."""
        return self.console.session

    @property
    def command(self) -> Command:
        """The command in force."""
        return self.console.command

    @property
    def start(self) -> Command:
        """Where it began."""
        return self.console.scene.start

    @property
    def last(self) -> ConsoleFrame | None:
        """The frame in force."""
        return self.console.last

    def step(self, command: Command | None = None, dt: float = 0.0) -> ConsoleFrame:
        """Come to a command, some time later."""
        frame = self.console.step(command, dt)
        self._meter.add(frame)
        return frame

    def check(self, command: Command) -> None:
        """Raise FieldError where a command is beyond the scene's limits."""
        self.console.scene.check(command)

    def summary(self, frame: ConsoleFrame) -> PassSummary:
        """Return what a page says of the pass; numbers of the tip only where these may be shown."""
        if "numbers" in self.guides:
            return self.measured(frame)
        return PassSummary(time_s=frame.metrics.time_s, passes=frame.metrics.passes, path_mm=None, blind_mm=None)

    def measured(self, frame: ConsoleFrame) -> PassSummary:
        """Return what is known of the pass."""
        path, blind = self._meter.found(frame.time_s)
        return PassSummary(time_s=frame.metrics.time_s, passes=frame.metrics.passes, path_mm=path, blind_mm=blind)

    def pause(self) -> None:
        """Let nothing happen until the next step."""
        self.console.pause()

    def close(self) -> None:
        """Nothing is to be ended."""

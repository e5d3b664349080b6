"""What the present pass of a needle comes to, while it goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .growing_trace import GrowingTrace
from .metric import METRICS
from .task import Task
from .trace import Sample

if TYPE_CHECKING:
    from ..geometry.needle import Needle
    from ..simulator.console_frame import ConsoleFrame

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

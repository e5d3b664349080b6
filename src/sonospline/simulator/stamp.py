"""Which command a frame answers, and since when."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Stamp:
    """Where a frame came from."""

    seq: int
    """Of the newest command in it."""
    since: float
    """``time.perf_counter()`` when that command came; of one that an older frame shows, when the frame was begun."""

"""Where a participant stands at an exercise: one line of the trainer's table."""

from __future__ import annotations

from datetime import datetime
from typing import NamedTuple


class Standing(NamedTuple):
    """One participant at one exercise; what is not known is None."""

    participant: str
    group: str | None
    exercise: str
    attempts: int
    passed: int
    last: datetime
    """When the last attempt began, UTC."""
    last_passed: bool
    last_verdict: str
    final_error_mm: float | None
    """Of the last attempt."""
    blind_advance_mm: float | None

    def __repr__(self) -> str:
        return f"Standing({self.participant} at {self.exercise!r}: {self.passed} of {self.attempts} passed)"

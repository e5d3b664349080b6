"""What stations ask of the course they belong to."""

from __future__ import annotations

from typing import Protocol

from ..server.seat import Seat
from .finished_attempt import FinishedAttempt
from .keeper import Say


class Office(Protocol):
    """Who knows participants and keeps results, for all stations."""

    keeps_recordings: bool

    def title(self, exercise: str) -> str:
        """Return what an exercise on offer is called."""

    def seat_of(self, code: str) -> Seat | None:
        """Return where a participant sits now."""

    async def why_unknown(self, code: str) -> str | None:
        """Return why nobody has a code; None where somebody has."""

    def keep(self, finished: FinishedAttempt, say: Say) -> None:
        """Have an attempt kept; in any thread."""

    def keep_comment(self, finished: FinishedAttempt, time_s: float, text: str, say: Say) -> None:
        """Have a comment kept, after its attempt."""

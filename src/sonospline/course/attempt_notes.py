"""What is known of an attempt at a station: who does it, since when, and what was said of it."""

from __future__ import annotations

import threading
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Protocol

from ..server.server_messages import Comment
from .finished_attempt import FinishedAttempt

if TYPE_CHECKING:
    from ..server.live_attempt import LiveAttempt
    from .office import Office


class Place(Protocol):
    """A station, as an attempt that is done there needs it; both in any thread."""

    def ended(self, attempt: LiveAttempt) -> None:
        """An attempt is over."""

    def report(self, line: str) -> None:
        """Say what goes wrong with its result."""


class AttemptNotes:
    """Go with an attempt, to whatever station goes on with it, and into the results when it ends.

    Parameters
    ----------
    participant : str
        Who does it.
    office : Office
        Who keeps it.
    station : Place
        Where it is done now.
    """

    def __init__(self, participant: str, office: Office, station: Place) -> None:
        self.participant, self._office, self.station = participant, office, station
        self.comments: list[Comment] = []
        """In the order of their times."""
        self._began = datetime.now(UTC)
        self._finished: FinishedAttempt | None = None
        self._ending = threading.Lock()  # a comment comes before the attempt's end, or after it

    def comment(self, time_s: float, text: str) -> None:
        """Say something of a moment."""
        with self._ending:
            self.comments = sorted([*self.comments, Comment(time_s=time_s, text=text)], key=lambda one: one.time_s)
            if self._finished is not None:
                self._office.keep_comment(self._finished, time_s, text, self._report)

    def __call__(self, ended: LiveAttempt) -> None:
        """Have the result kept, and what was said; in the thread that stepped it."""
        result = ended.attempt.result
        if result is None:
            return
        recording = ended.recording
        path = recording.path if self._office.keeps_recordings and not recording.problem else None
        finished = FinishedAttempt(self.participant, result, self._began, path)
        self._office.keep(finished, self._report)
        with self._ending:
            self._finished = finished
            for comment in self.comments:
                self._office.keep_comment(finished, comment.time_s, comment.text, self._report)
        self.station.ended(ended)

    def _report(self, line: str) -> None:
        self.station.report(line)

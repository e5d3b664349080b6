"""An attempt at a station that is over, on its way into the results."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from uuid import uuid4

from ..lab.attempt_record import AttemptRecord
from ..lab.result_store import ResultStore
from ..training.attempt import Result

logger = logging.getLogger(__name__)


@dataclass
class FinishedAttempt:
    """What is kept of an attempt, and its number once it is.

    Parameters
    ----------
    participant : str
        A code.
    result : Result
        What it came to.
    began : datetime
        In UTC.
    recording : Path, optional
        The file it was recorded in.
    """

    participant: str
    result: Result
    began: datetime
    recording: Path | None = None
    number: int | None = None
    """In the results; None before it is kept."""
    key: str = field(default_factory=lambda: uuid4().hex)
    """So that it is kept once, where an answer of the results is lost."""

    def keep(self, store: ResultStore, course: str) -> None:
        """Write it into the results.

        Raises
        ------
        LabDatabaseError
            They are away or full.
        """
        if self.participant not in dict(store.participants()):  # sat down while the results were away
            store.add_participant(self.participant)
        self.number = store.add(self.participant, self._record(), session=course, key=self.key)

    def comment(self, store: ResultStore, time_s: float, text: str, *, key: str) -> None:
        """Write a comment on it, after it was kept; once under a key.

        Raises
        ------
        ValueError
            It was not kept.
        LabDatabaseError
            The results are away or full.
        """
        if self.number is None:
            raise ValueError(f"the attempt was not kept, and neither is its comment {text!r}")
        store.add_comment(self.number, time_s, text, key=key)

    def _record(self) -> AttemptRecord:
        try:
            return AttemptRecord.of(self.result, began=self.began, recording=self.recording)
        except OSError as error:
            logger.warning("a recording is not among the results: %s", error)
            return AttemptRecord.of(self.result, began=self.began)

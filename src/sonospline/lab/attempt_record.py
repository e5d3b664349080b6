"""What the lab keeps of one attempt."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from .._digest import digest_of_bytes
from ..training.attempt import Result


@dataclass(frozen=True, repr=False)
class AttemptRecord:
    """One attempt at an exercise, as it is kept.

    Parameters
    ----------
    exercise : str
        Its name.
    exercise_hash : str
        Of its content: exercises of one name may have changed between two courses.
    seed : int
        Of the start.
    ended : str
        How: "on target", "given up", "time is up", "too many passes".
    passed : bool
        Whether every mark was reached.
    verdict : str
        In words.
    seconds : float
        How long it took.
    metrics : dict of str to float
        By the names of :data:`~sonospline.training.METRICS`; what is not known is not in it.
    began : datetime
        In UTC.
    recording : str, optional
        Name of its file.
    recording_hash : str, optional
        Of the file's content.
    """

    exercise: str
    exercise_hash: str
    seed: int
    ended: str
    passed: bool
    verdict: str
    seconds: float
    metrics: dict[str, float]
    began: datetime = field(default_factory=lambda: datetime.now(UTC))
    recording: str | None = None
    recording_hash: str | None = None

    @classmethod
    def of(cls, result: Result, *, began: datetime | None = None, recording: Path | None = None) -> AttemptRecord:
        """Return that of a result, and of the file it was recorded in.

        Raises
        ------
        FileNotFoundError
            There is no such recording.
        """
        known = {name: value for name, value in result.metrics.items() if value == value}
        return cls(
            exercise=result.exercise.name, exercise_hash=result.exercise.content_hash, seed=result.seed,
            ended=result.ended, passed=result.passed, verdict=result.verdict, seconds=known["time_s"], metrics=known,
            began=began or datetime.now(UTC), recording=None if recording is None else recording.name,
            recording_hash=None if recording is None else digest_of_bytes(recording.read_bytes()),
        )  # fmt: skip

    def __repr__(self) -> str:
        return f"AttemptRecord({self.exercise!r}, {self.ended}, {'passed' if self.passed else 'not yet'})"

"""Attempts written down: each in a file of its own, and a disk that is full ends the writing and nothing else."""

from __future__ import annotations

import contextlib
import logging
import secrets
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .._extras import MissingExtraError

if TYPE_CHECKING:
    from ..simulator.simulated_frame import SimulatedFrame
    from .attempt import Attempt
    from .recorder import Recorder
    from .recording import Recording

logger = logging.getLogger(__name__)


class AttemptRecording:
    """What is written down of one attempt.

    Parameters
    ----------
    path : Path
        The new file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problem = ""
        """Why nothing is written down any more; empty where all is well."""
        self.on_problem: Callable[[str], object] = lambda line: None
        """Called once with the problem, in the thread that writes."""
        self._recorder: Recorder | None = None

    def begin(self, attempt: Attempt) -> None:
        """Make the file; where that cannot be, the attempt goes on without."""
        from .recorder import Recorder

        try:
            self._recorder = Recorder(self.path, attempt.scene, about=about(attempt))
        except (MissingExtraError, OSError) as error:
            self._fail(error)

    def add(self, frame: SimulatedFrame) -> None:
        """Write down a step, as long as that is possible."""
        if self._recorder is None:
            return
        try:
            self._recorder.add(frame)
        except (OSError, ValueError) as error:
            self._fail(error)

    def close(self) -> None:
        """End the file."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            try:
                recorder.close()
            except OSError as error:
                self._fail(error)

    def read(self) -> Recording | None:
        """Return what was written down; None where there is nothing that can be replayed."""
        if not self.path.is_file():
            return None
        from .recording import Recording

        try:
            return Recording.read(self.path)
        except (ValueError, OSError) as error:
            self._fail(error)
            return None

    def _fail(self, error: Exception) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            with contextlib.suppress(OSError):  # what was kept before stays
                recorder.close()
        if not self.problem:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            self.problem = f"The attempt is not recorded: {reason}"
            logger.warning("%s: %s", self.path.name, reason)
            self.on_problem(self.problem)


def about(attempt: Attempt) -> dict[str, str]:
    """Return what a recording says of its attempt."""
    exercise = attempt.exercise
    return {"exercise": exercise.name, "exercise_hash": exercise.content_hash, "seed": str(attempt.seed)}


class Recordings:
    """Where attempts are written down.

    Parameters
    ----------
    folder : Path, optional
        It is made where it is not there. By default attempts are kept until the server ends, for their debriefs.
    """

    def __init__(self, folder: Path | None = None) -> None:
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._own: tempfile.TemporaryDirectory[str] | None = None

    def new(self, exercise: str, seed: int) -> AttemptRecording:
        """Return one for an attempt: named by exercise, time and seed."""
        now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
        return AttemptRecording(self._place() / f"{exercise}-{now}-{seed}-{secrets.token_hex(2)}.mcap")

    def close(self) -> None:
        """Remove what was to be kept until now."""
        if self._own is not None:
            self._own.cleanup()

    def _place(self) -> Path:
        if self._folder is not None:
            return self._folder
        if self._own is None:
            self._own = tempfile.TemporaryDirectory(prefix="sonospline-attempts-", ignore_cleanup_errors=True)
        return Path(self._own.name)

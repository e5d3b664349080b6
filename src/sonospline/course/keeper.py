"""Keeps results in the order in which they came; what cannot be kept now is said at once, and waits."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from ..lab.database import LabDatabaseError, LabDataError

logger = logging.getLogger(__name__)

Job = Callable[[], object]
Say = Callable[[str], object]

RETRY_S = 5.0


class _Waiting(NamedTuple):
    job: Job
    say: Say


class Keeper:
    """Does jobs that write to the results, one after the other, in a thread of its own.

    A job that fails because the database is away or full is done again until it succeeds; those behind it wait. At the
    end each is tried once more, and one that the database will never take is given up at once.

    Parameters
    ----------
    retry_s : float, default: 5
        Seconds until a job that failed is tried again.

    Examples
    --------
    >>> from sonospline.course.keeper import Keeper
    >>> kept = []
    >>> keeper = Keeper()
    >>> keeper.do(lambda: kept.append("K-17: passed"), say=print)
    >>> keeper.close(within_s=5.0)
    0
    >>> kept
    ['K-17: passed']
    """

    def __init__(self, retry_s: float = RETRY_S) -> None:
        self._retry_s = retry_s
        self._waiting: deque[_Waiting] = deque()
        self._changed = threading.Condition()
        self._closing = False
        self.problem = ""
        """Why something waits; empty where all is well."""
        self._thread = threading.Thread(target=self._run, name="sonospline-results", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """How many jobs are not done yet."""
        return len(self._waiting)

    def do(self, job: Job, say: Say) -> None:
        """Have something written, soon; ``say`` hears in one line what goes wrong with it."""
        with self._changed:
            self._waiting.append(_Waiting(job, say))
            self._changed.notify()
        if self.problem:
            say(_not_yet(self.problem))

    def close(self, within_s: float) -> int:
        """Try once more what waits, and end; return how many jobs could not be done."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(within_s)
        for _ in tuple(self._waiting):
            logger.error("a result was not kept: %s", self.problem or "there was no time")
        return len(self._waiting)

    def _run(self) -> None:
        while not self._closing:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
            if self._waiting and not self._closing and not self._tried(self._waiting[0]):
                with self._changed:
                    self._changed.wait_for(lambda: self._closing, self._retry_s)
        failed = [self.problem for one in tuple(self._waiting) if not self._tried(one)]
        self.problem = failed[-1] if failed else ""

    def _tried(self, one: _Waiting) -> bool:
        """Whether a job is over, and waits no more."""
        over = self._done(one)
        if over:
            with self._changed:
                self._waiting.remove(one)
        return over

    def _done(self, first: _Waiting) -> bool:
        """Whether a job is over: it succeeded, or never will."""
        try:
            first.job()
        except (LabDatabaseError, OSError) as error:
            if isinstance(error, LabDataError):
                return _given_up(first, error)
            if not self.problem:
                logger.warning("results wait: %s", error)
                first.say(_not_yet(str(error)))
            self.problem = str(error)
            return False
        except Exception as error:
            return _given_up(first, error)
        if self.problem:
            self.problem = ""
            logger.warning("results are kept again")
        return True


def _given_up(one: _Waiting, error: Exception) -> bool:
    logger.error("a result could not be kept", exc_info=error)
    one.say(f"The result could not be kept: {error}")
    return True


def _not_yet(problem: str) -> str:
    return f"The result is not kept yet, and will be tried again: {problem}"

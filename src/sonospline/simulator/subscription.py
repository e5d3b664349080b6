"""One subscriber of a runner's frames: what waits for it, and what it was given."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple

from .. import _validate

if TYPE_CHECKING:
    from .console_frame import ConsoleFrame
    from .stamp import Stamp

logger = logging.getLogger(__name__)

Callback = Callable[["ConsoleFrame", "Stamp"], None]
OnError = Callable[[str], None]
WhenFull = Literal["latest", "refuse"]

ERRORS_APART_S = 1.0
"""An error that repeats is reported again after so long."""
SLOW_S = 0.02
"""A quick subscriber that takes longer than this is slow,"""
_SLOW_FRAMES = 3
"""and gets a thread of its own after so many such frames in a row."""
_MOST_ERRORS = 16
"""Errors that wait for a subscriber; older ones are dropped."""


class _Waiting(NamedTuple):
    """A frame that waits, and how many before it were lost."""

    frame: ConsoleFrame
    stamp: Stamp
    lost: int


class Subscription:
    """A subscriber's place at a :class:`~sonospline.simulator.Runner`; made by its ``subscribe``.

    Frames and errors reach the subscriber one after the other in a thread of its own, so that one
    that is slow, blocked or broken delays nobody else.
    """

    def __init__(
        self,
        callback: Callback,
        *,
        on_error: OnError | None = None,
        ready: Callable[[], bool] | None = None,
        capacity: int = 1,
        when_full: WhenFull = "latest",
        quick: bool = False,
        wake_loop: Callable[[], None] = lambda: None,
    ) -> None:
        self._callback, self._on_error, self._ready, self._wake_loop = callback, on_error, ready, wake_loop
        self._capacity = _validate.count("capacity", capacity)
        self._refuses = _validate.choice("when_full", when_full, ("latest", "refuse")) == "refuse"
        self._frames: deque[_Waiting] = deque()
        self._errors: deque[str] = deque(maxlen=_MOST_ERRORS)
        self._said = ErrorLog()
        self._changed = threading.Condition()
        self._notices = self._lost_in_a_row = self._slow_frames = 0
        self._closed = False
        self._thread: threading.Thread | None = None
        self.given = 0
        """Frames handed on."""
        self.dropped = 0
        """Frames that were not: a newer one took the place, or there was none."""
        if not quick:
            self._start()

    def close(self) -> None:
        """End it: no frame is taken any more. One that refuses when full is still given those that wait."""
        with self._changed:
            self._closed = True
            if not self._refuses:
                self.dropped += len(self._frames)
                self._frames.clear()
            self._notify()

    def join(self, timeout: float | None = None) -> None:
        """Wait until the thread has ended, at most so many seconds."""
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout)

    def wake(self) -> None:
        """Ask again whether the subscriber is ready."""
        self._notify()
        self._wake_loop()

    @property
    def closed(self) -> bool:
        """Whether it takes no frames any more."""
        return self._closed

    @property
    def is_ready(self) -> bool:
        """Whether another frame is welcome."""
        if self._closed:
            return False
        try:
            return self._ready is None or bool(self._ready())
        except Exception as error:
            self.report(self._said.line_of(error, "a subscriber could not say whether it is ready"))
            return False

    def offer(self, frame: ConsoleFrame, stamp: Stamp) -> None:
        """Take a frame, or drop it or an older one; in the runner's thread."""
        with self._changed:
            if self._closed:
                return
            if len(self._frames) >= self._capacity:
                self.dropped += 1
                if self._refuses:
                    self._lost_in_a_row += 1
                    return
                self._frames.popleft()
            self._frames.append(_Waiting(frame, stamp, self._lost_in_a_row))
            self._lost_in_a_row = 0
            self._notify()
        if self._thread is None:
            self.hand_on()

    def report(self, line: str | None) -> None:
        """Take an error; None is none."""
        if line is None or self._on_error is None:
            return
        with self._changed:
            self._errors.append(line)
            self._notify()
        if self._thread is None:
            self.hand_on()

    def hand_on(self) -> None:
        """Hand on what waits, as far as the subscriber is ready, in the calling thread; not where it has its own."""
        while self._thread is None and (item := self._next()) is not None:
            began = time.perf_counter()
            self._give(item)
            self._slow_frames = self._slow_frames + 1 if time.perf_counter() - began > SLOW_S else 0
            if self._slow_frames >= _SLOW_FRAMES:
                logger.warning("a quick subscriber took over %.0f ms a frame: it gets its own thread", 1e3 * SLOW_S)
                self._start()

    @property
    def can_hand_on(self) -> bool:
        """Whether something waits that :meth:`hand_on` would hand on."""
        return self._thread is None and bool(self._errors or (self._frames and self.is_ready))

    def _start(self) -> None:
        self._thread = threading.Thread(target=self._run, name="sonospline-subscriber", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            seen = self._notices
            item = self._next()
            if item is not None:
                self._give(item)
                del item  # a frame shall not live on in a thread that waits
                continue
            with self._changed:
                if self._closed and not self._frames:
                    return
                if self._notices == seen:
                    self._changed.wait()

    def _notify(self) -> None:
        with self._changed:
            self._notices += 1
            self._changed.notify()

    def _next(self) -> _Waiting | str | None:
        """Take out what comes next. Whether the subscriber is ready is asked without the lock: it may hold its own."""
        with self._changed:
            if self._errors:
                return self._errors.popleft()
            if not self._frames:
                return None
        if not (self._closed or self.is_ready):
            return None
        with self._changed:
            return self._frames.popleft() if self._frames else None

    def _give(self, item: _Waiting | str) -> None:
        if isinstance(item, str):
            self._say(item)
            return
        if item.lost:
            self._say(f"{item.lost} frames were lost before frame {item.frame.number}; {self._remedy}")
        try:
            self._callback(item.frame, item.stamp)
            self.given += 1
        except Exception as error:
            self.report(self._said.line_of(error, "a subscriber failed"))

    def _say(self, line: str) -> None:
        try:
            if self._on_error is not None:
                self._on_error(line)
        except Exception as error:
            self._said.line_of(error, "a subscriber failed at an error")

    @property
    def _remedy(self) -> str:
        return f"take them faster, or give more than capacity = {self._capacity}"


class ErrorLog:
    """Errors as one line each, logged; the same one again only after a while."""

    def __init__(self) -> None:
        self._line, self._when = "", -ERRORS_APART_S

    def line_of(self, error: Exception, what: str) -> str | None:
        """Return an error's line; None where it was said a moment ago."""
        line, now = str(error) or type(error).__name__, time.perf_counter()
        if line == self._line and now - self._when < ERRORS_APART_S:
            return None
        self._line, self._when = line, now
        if isinstance(error, ValueError):
            logger.warning("refused: %s", line)
        else:
            logger.error("%s: %s", what, line, exc_info=error)
        return line

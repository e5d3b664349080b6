"""A session in a thread of its own, at a steady rate: the newest command wins."""

from __future__ import annotations

import atexit
import logging
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .arrival_clock import ArrivalClock
from .command import Command

if TYPE_CHECKING:
    from .session import Session
    from .shot import Shot

logger = logging.getLogger(__name__)

RATE_HZ = 90.0
IDLE_HZ = 8.0
"""Frames a second while nothing happens: electronic noise lives."""
_FAULTS_APART_S = 1.0
_FRESH_S = 0.003
_LAST_STEP_S = 5.0
"""How long the end of the process waits for steps that are under way."""

_runners: weakref.WeakSet[Runner] = weakref.WeakSet()


@atexit.register
def _end_all() -> None:
    """End the threads while the interpreter is whole: a step that outlives it has no Python to return to."""
    runners, deadline = list(_runners), time.monotonic() + _LAST_STEP_S
    for runner in runners:
        runner.stop()
    for runner in runners:
        runner.join(max(0.0, deadline - time.monotonic()))


@dataclass(frozen=True)
class Stamp:
    """Where a frame came from."""

    seq: int
    """Of the newest command in it."""
    since: float
    """``time.perf_counter()`` when that command came; of one that an older frame shows, when the frame was begun."""


@dataclass(frozen=True)
class _Asked:
    command: Command
    seq: int
    since: float


Deliver = Callable[["Shot", Stamp], None]
Action = Callable[["Session"], Any]
Complain = Callable[[str], None]


class Runner:
    """Steps a session at a fixed rate and hands every new picture on.

    While nothing changes it makes a few pictures a second; while the session is frozen, none. A step that fails is
    logged and reported, and the last good picture stays.

    Parameters
    ----------
    session : Session
        Touched by the runner's thread alone from now on; use :meth:`do` for everything but commands.
    deliver : callable
        Called as ``deliver(shot, stamp)`` in the runner's thread.
    complain : callable, optional
        Called with one line in the runner's thread when a step or a action fails.
    ready : callable, optional
        Asked before each step whether a picture could be handed on; call :meth:`wake` when that changes.
    rate_hz : float, default: 90
        Most pictures a second.

    Examples
    --------
    >>> import threading
    >>> from sonospline.simulator import Runner, SceneFile, Session
    >>> scene = SceneFile.parse('''name = "Small block"
    ... tissue = {source = "gel block", voxel_mm = 1.0, nodes = 5000}
    ... probe = {kind = "linear", frequency_mhz = 3, depth_mm = 40, lines = 64}
    ... needle = {u = -34, angle = 38}
    ... ''')
    >>> session, seen = Session(scene, model="paper"), threading.Event()
    >>> with Runner(session, lambda shot, stamp: seen.set() if stamp.seq == 7 else None) as runner:
    ...     runner.ask(session.scene.start.with_needle(depth=20), 7)
    ...     seen.wait(60)
    True
    >>> session.command.needle.depth
    20
    """

    def __init__(
        self,
        session: Session,
        deliver: Deliver,
        *,
        complain: Complain | None = None,
        ready: Callable[[], bool] | None = None,
        rate_hz: float = RATE_HZ,
    ) -> None:
        self.session = session
        self._deliver, self._complain = deliver, complain or (lambda line: None)
        self._ready = ready or (lambda: True)
        self._period = 1 / rate_hz
        self._queue: deque[_Asked | Action] = deque()
        self._changed = threading.Condition()
        self._arrivals = ArrivalClock()
        self._closed = False
        self._seq = 0
        self._restless = True
        self._complained: tuple[str, float] = ("", -_FAULTS_APART_S)
        self._thread = threading.Thread(target=self._run, name="sonospline-session", daemon=True)
        _runners.add(self)
        self._thread.start()

    def ask(self, command: Command, seq: int, since: float | None = None) -> None:
        """Command for something; an older command that was not yet looked at is forgotten."""
        asked = _Asked(command, seq, time.perf_counter() if since is None else since)
        with self._changed:
            self._arrivals.beat(asked.since)
            if self._queue and isinstance(self._queue[-1], _Asked):
                self._queue.pop()
            self._queue.append(asked)
            self._changed.notify()

    def do(self, action: Action) -> None:
        """Have something else done to the session, after the commands before it and before those after it."""
        with self._changed:
            self._queue.append(action)
            self._changed.notify()

    @property
    def waiting(self) -> int:
        """How many commands and actions were not looked at yet."""
        return len(self._queue)

    def wake(self) -> None:
        """Look again whether a picture could be handed on."""
        with self._changed:
            self._changed.notify()

    def stop(self) -> None:
        """Have the thread end after the step it is in."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    @property
    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.is_alive()

    def join(self, timeout: float | None = None) -> None:
        """Wait until the thread has ended, at most so many seconds."""
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    def close(self) -> None:
        """End the thread, and wait until it has ended."""
        self.stop()
        self.join()

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def _run(self) -> None:
        begun = -1.0
        while self._wait(begun):
            begun = time.perf_counter()
            asked = self._obey()
            try:
                shot = self.session.step(None if asked is None else asked.command)
                if asked is not None:
                    self._seq = asked.seq
                self._restless = not shot.settled and not shot.command.frozen
                self._deliver(shot, Stamp(self._seq, begun if asked is None else asked.since))
            except Exception as error:  # the session goes on with its last picture, whatever failed
                self._restless = False
                self._fault(error)

    def _wait(self, begun: float) -> bool:
        """Sleep until there is something to do; False when closed."""
        with self._changed:
            while not self._closed:
                now = time.perf_counter()
                busy = bool(self._queue) or self._restless
                frozen = self.session.command.frozen and self.session.last is not None
                due = begun + (self._period if busy else 1 / IDLE_HZ)
                may = self._ready() and (busy or not frozen)
                if may and busy:
                    due = max(due, self._next_command(now))
                if may and now >= due:
                    return True
                self._changed.wait(due - now if may else None)
            return False

    def _next_command(self, now: float) -> float:
        """When to stop waiting for a command that will take the place of the only one there is; else long ago."""
        stale = len(self._queue) == 1 and isinstance(self._queue[0], _Asked) and self._queue[0].since < now - _FRESH_S
        return (self._arrivals.worth_waiting_until(now) if stale else None) or -1.0

    def _obey(self) -> _Asked | None:
        """Do what was asked up to the next command, and return that."""
        while True:
            with self._changed:
                if not self._queue:
                    return None
                item = self._queue.popleft()
            if isinstance(item, _Asked):
                return item
            try:
                item(self.session)
            except Exception as error:
                self._fault(error)

    def _fault(self, error: Exception) -> None:
        line, now = str(error) or type(error).__name__, time.perf_counter()
        said, when = self._complained
        if line == said and now - when < _FAULTS_APART_S:
            return
        self._complained = (line, now)
        if isinstance(error, ValueError):
            logger.warning("refused: %s", line)
        else:
            logger.error("a step failed, the last picture stays: %s", line, exc_info=error)
        self._complain(line)

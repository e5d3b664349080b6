"""A console in a thread of its own, at a steady rate: the newest command wins."""

from __future__ import annotations

import atexit
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from .arrival_clock import ArrivalClock
from .command import Command
from .stamp import Stamp
from .subscription import Callback, ErrorLog, OnError, Subscription, WhenFull

if TYPE_CHECKING:
    from .console_frame import ConsoleFrame
    from .scene import Scene

RATE_HZ = 90.0
IDLE_HZ = 8.0
"""Frames a second while nothing happens: electronic noise lives."""
_FRESH_S = 0.003
_LONGEST_DT_S = 0.25
"""Time that passes for the tissue between two steps, at most: while nothing is stepped, it stands still."""
_LAST_STEP_S = 5.0
"""How long the end of the process waits for steps that are under way."""
_LAST_FRAME_S = 1.0
"""How long a runner that ends waits for its subscribers."""

_runners: weakref.WeakSet[Runner[Any]] = weakref.WeakSet()


@atexit.register
def _end_all() -> None:
    """End the threads while the interpreter is whole: a step that outlives it has no Python to return to."""
    runners, deadline = list(_runners), time.monotonic() + _LAST_STEP_S
    for runner in runners:
        runner.stop()
    for runner in runners:
        runner.join(max(0.0, deadline - time.monotonic()))


@dataclass(frozen=True)
class _Submitted:
    command: Command
    seq: int
    since: float


class Stepped(Protocol):
    """What a runner steps: a console, or what has one."""

    @property
    def scene(self) -> Scene:
        """What it is in."""

    @property
    def command(self) -> Command:
        """The command in force."""

    @property
    def last(self) -> ConsoleFrame | None:
        """The frame in force."""

    def step(self, command: Command | None = None, dt: float = 0.0) -> ConsoleFrame:
        """Come to a command, some time later."""


S = TypeVar("S", bound=Stepped)


class Runner(Generic[S]):
    """Steps a console at a fixed rate, in a thread of its own, and hands every new frame to its subscribers.

    While nothing changes it makes a few frames a second; while the console is frozen, or every
    subscriber says that it is not ready, none. A step that fails is logged and reported to all, and
    the last good frame stays.

    Parameters
    ----------
    console : Console
        Touched by the runner's thread alone from now on; use :meth:`do` for everything but commands.
    rate_hz : float, default: 90
        Most frames a second.

    Examples
    --------
    >>> import threading
    >>> from sonospline.simulator import Console, Runner, SceneFile, Session
    >>> scene = SceneFile.parse('''name = "Small block"
    ... tissue = {source = "gel block", voxel_mm = 1.0, nodes = 5000}
    ... probe = {kind = "linear", frequency_mhz = 3, depth_mm = 40, lines = 64}
    ... needle = {u = -34, angle = 38}
    ... ''')
    >>> console, seen = Console(Session(scene, model="paper")), threading.Event()
    >>> with Runner(console) as runner:
    ...     subscription = runner.subscribe(lambda frame, stamp: seen.set() if stamp.seq == 7 else None)
    ...     runner.submit(console.scene.start.with_needle(depth=20), 7)
    ...     seen.wait(60)
    True
    >>> console.command.needle.depth, subscription.given > 0, subscription.closed
    (20, True, True)
    """

    def __init__(self, console: S, *, rate_hz: float = RATE_HZ) -> None:
        self.console = console
        self._period = 1 / rate_hz
        self._subscriptions: tuple[Subscription, ...] = ()
        self._queue: deque[_Submitted | Callable[[S], Any]] = deque()
        self._changed = threading.Condition()
        self._arrivals = ArrivalClock()
        self._closed = False
        self._seq = 0
        self._stepped: _Submitted | None = None
        self._restless = True
        self._errors = ErrorLog()
        self._thread = threading.Thread(target=self._run, name="sonospline-session", daemon=True)
        _runners.add(self)
        self._thread.start()

    def subscribe(
        self,
        callback: Callback,
        *,
        on_error: OnError | None = None,
        ready: Callable[[], bool] | None = None,
        capacity: int = 1,
        when_full: WhenFull = "latest",
        quick: bool = False,
    ) -> Subscription:
        """Hand frames to a subscriber from now on, in a thread of its own.

        Parameters
        ----------
        callback : callable
            Called as ``callback(frame, stamp)``, one frame after the other.
        on_error : callable, optional
            Called with one line, in the same thread, when a step or an action failed, when the
            callback raised, or when frames were refused.
        ready : callable, optional
            Whether a frame is welcome; it must answer at once, in any thread. Call the subscription's
            ``wake`` when the answer changes.
        capacity : int, default: 1
            Frames that may wait while the subscriber is busy or not ready.
        when_full : {"latest", "refuse"}, default: "latest"
            Whether a new frame takes the place of the oldest that waits, or is refused: ``"refuse"``
            with a large capacity gives every frame, and an error where some were lost.
        quick : bool, default: False
            Have frames handed on in the session's own thread, without the tenth of a millisecond that
            another one takes to wake. For a callback that takes few milliseconds and waits for nothing;
            one that is slow three times in a row gets a thread after all.

        Returns
        -------
        Subscription
            With counts of the frames given and dropped, ``wake`` and ``close``.
        """
        subscription = Subscription(
            callback, on_error=on_error, ready=ready, capacity=capacity, when_full=when_full, quick=quick,
            wake_loop=self.wake,
        )  # fmt: skip
        with self._changed:
            self._subscriptions = (*(one for one in self._subscriptions if not one.closed), subscription)
            if self._closed:
                subscription.close()
            self._changed.notify()
        return subscription

    def submit(self, command: Command, seq: int, since: float | None = None) -> None:
        """Give a command; an older one that was not yet looked at is forgotten.

        Parameters
        ----------
        command : Command
            The whole of it.
        seq : int
            Its number, which the stamp of its frames has.
        since : float, optional
            ``time.perf_counter()`` when it came; by default now.
        """
        submitted = _Submitted(command, seq, time.perf_counter() if since is None else since)
        with self._changed:
            self._arrivals.beat(submitted.since)
            if self._queue and isinstance(self._queue[-1], _Submitted):
                self._queue.pop()
            self._queue.append(submitted)
            self._changed.notify()

    def amend(self, change: Callable[[Command], Command]) -> None:
        """Change the newest command, whether it was looked at or still waits, beside whoever gives commands.

        Raises
        ------
        FieldError
            What it becomes is beyond the scene's limits.
        """
        with self._changed:
            waiting = (item for item in reversed(self._queue) if isinstance(item, _Submitted))
            newest = next(waiting, self._stepped)
            command = change(self.console.command if newest is None else newest.command)
            self.console.scene.check(command)
            self.submit(command, self._seq if newest is None else newest.seq)

    def do(self, action: Callable[[S], Any]) -> None:
        """Have something else done to the console, after the commands before it and before those after it."""
        with self._changed:
            self._queue.append(action)
            self._changed.notify()

    @property
    def waiting(self) -> int:
        """How many commands and actions were not looked at yet."""
        return len(self._queue)

    def wake(self) -> None:
        """Look again whether a frame is welcome."""
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
        """End the thread, and wait until it and those of the subscribers have ended; not long for one that is stuck."""
        self.stop()
        self.join()
        deadline = time.monotonic() + _LAST_FRAME_S
        for subscription in self._subscriptions:
            subscription.join(max(0.0, deadline - time.monotonic()))

    def __enter__(self) -> Runner[S]:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def _run(self) -> None:
        begun = -1.0
        while self._wait(begun):
            before, begun = begun, time.perf_counter()
            submitted = self._obey()
            dt = round(min(begun - before, _LONGEST_DT_S), 6) if before >= 0 else 0.0  # what recordings keep
            try:
                frame = self.console.step(None if submitted is None else submitted.command, dt)
            except Exception as error:  # the console goes on with its last frame, whatever failed
                self._restless, self._stepped = False, None
                self._report(error)
                continue
            self._seq, self._stepped = self._seq if submitted is None else submitted.seq, None
            self._restless = (frame.moves or not frame.settled) and not frame.command.frozen
            stamp = Stamp(self._seq, begun if submitted is None else submitted.since)
            for subscription in self._subscriptions:
                subscription.offer(frame, stamp)
        for subscription in self._subscriptions:
            subscription.close()

    def _wait(self, begun: float) -> bool:
        """Sleep until there is something to do; False when closed."""
        while True:
            for subscription in self._subscriptions:
                subscription.hand_on()
            with self._changed:
                if self._closed:
                    return False
                if any(one.can_hand_on for one in self._subscriptions):
                    continue  # it became ready meanwhile
                now = time.perf_counter()
                busy = bool(self._queue) or self._restless
                frozen = self.console.command.frozen and self.console.last is not None
                due = begun + (self._period if busy else 1 / IDLE_HZ)
                may = self._is_wanted() and (busy or not frozen)
                if may and busy:
                    due = max(due, self._next_command(now))
                if may and now >= due:
                    return True
                self._changed.wait(due - now if may else None)

    def _is_wanted(self) -> bool:
        """Whether anybody welcomes a frame; without subscribers, commands are followed all the same."""
        open_ones = [one for one in self._subscriptions if not one.closed]
        return any(one.is_ready for one in open_ones) if open_ones else bool(self._queue)

    def _next_command(self, now: float) -> float:
        """When to stop waiting for a command that will take the place of the only one there is; else long ago."""
        only = self._queue[0] if len(self._queue) == 1 else None
        stale = isinstance(only, _Submitted) and only.since < now - _FRESH_S
        return (self._arrivals.worth_waiting_until(now) if stale else None) or -1.0

    def _obey(self) -> _Submitted | None:
        """Do what waits up to the next command, and return that."""
        while True:
            with self._changed:
                if not self._queue:
                    return None
                item = self._queue.popleft()
                self._stepped = item if isinstance(item, _Submitted) else self._stepped
            if isinstance(item, _Submitted):
                return item
            try:
                item(self.console)
            except Exception as error:
                self._report(error)

    def _report(self, error: Exception) -> None:
        line = self._errors.line_of(error, "a step failed, the last frame stays")
        for subscription in self._subscriptions:
            subscription.report(line)

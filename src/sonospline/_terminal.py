"""What a command line owes its caller: streams that close early, and signals that end it."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TextIO

_ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))

_INSIST_S = 0.5
_signal: int | None = None
"""The signal that ends this process, once it came."""


@contextmanager
def signals_that_clean_up() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into SystemExit (143, 129), so that what is staged is removed on the way out.

    A signal that somebody handles or ignores (``nohup``) is left to them; so are the handlers of a server that runs
    inside.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, _leave)
    try:
        yield
    finally:
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0)
        for number in ours:
            if signal.getsignal(number) is _leave:
                signal.signal(number, signal.SIG_DFL)


def _leave(number: int, frame: FrameType | None) -> None:
    """Raise SystemExit, and again until it is on its way: compiled modules swallow one now and then."""
    global _signal
    _signal = number
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, lambda _, frame: _leave(number, frame))
        signal.setitimer(signal.ITIMER_REAL, _INSIST_S)
    if not isinstance(sys.exc_info()[1], SystemExit):  # where it is, somebody is cleaning up
        raise SystemExit(128 + number)


def leave_if_signalled(error: Exception) -> None:
    """Raise SystemExit where a signal came that a compiled module turned into some other error."""
    if _signal is not None:
        raise SystemExit(128 + _signal) from error


def say(text: str) -> None:
    """Write a line to stderr, if anybody is there to read it."""
    if sys.stderr is None:
        return
    try:
        print(text, file=sys.stderr, flush=True)  # noqa: T201
    except OSError:
        discard(sys.stderr)


def answer(text: str) -> None:
    """Write the result to stdout; a reader that has seen enough (``| head``) is no failure, a full disk is."""
    if sys.stdout is None:
        return
    try:
        print(text, flush=True)  # noqa: T201
    except BrokenPipeError:
        discard(sys.stdout)
    except OSError:
        discard(sys.stdout)
        raise


def discard(stream: TextIO) -> None:
    """Send what a stream still holds, and all that comes, nowhere: at exit it would fail again."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)

"""How far a long run is, how fast, and how long it will take: a bar where somebody watches, else lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .. import _terminal
from ._progress import watched

_EVERY_S = 10.0
_WORDS = ("samples", "failed")
"""What is counted, and what else became of some."""


@contextmanager
def rate(
    label: str, *, quiet: bool = False, words: tuple[str, str] = _WORDS
) -> Iterator[Callable[[int, int, int], None]]:
    """Yield a function of samples done, all, and failed, which says how far the run is."""
    if quiet:
        yield lambda done, of, failed: None
    elif watched():
        with _drawn(label, words) as tell:
            yield tell
    else:
        yield _Lines(label, words)


class Pace:
    """Samples a second since a run began, and the seconds that are left."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began: tuple[float, int] | None = None

    def at(self, done: int, of: int) -> tuple[float, float]:
        """Return both, for so many samples done; nan where nothing is known yet."""
        now = self._clock()
        if self._began is None:
            self._began = now, done
        start, there = self._began
        if done <= there or now <= start:
            return float("nan"), float("nan")
        a_second = (done - there) / (now - start)
        return a_second, (of - done) / a_second


class _Lines:
    """A line on stderr, at most one in ten seconds."""

    def __init__(self, label: str, words: tuple[str, str]) -> None:
        self._label, self._words, self._pace, self._said = label, words, Pace(), time.monotonic()

    def __call__(self, done: int, of: int, failed: int) -> None:
        a_second, left = self._pace.at(done, of)
        if time.monotonic() - self._said < _EVERY_S:
            return
        self._said = time.monotonic()
        _terminal.say(text(self._label, done, of, failed, a_second, left, self._words))


def text(
    label: str, done: int, of: int, failed: int, a_second: float, left_s: float, words: tuple[str, str] = _WORDS
) -> str:
    """Return a line that says how far a run is."""
    known = a_second == a_second
    pace = f", {a_second:.3g} a second, {_duration(left_s)} left" if known else ""
    return f"{label}: {done:,} of {of:,} {words[0]}{pace}" + (f"; {failed:,} {words[1]}" if failed else "")


def _duration(seconds: float) -> str:
    minutes, hours = seconds / 60, seconds / 3600
    return f"{hours:.1f} h" if hours >= 1 else f"{minutes:.0f} min" if minutes >= 2 else f"{seconds:.0f} s"


@contextmanager
def _drawn(label: str, words: tuple[str, str]) -> Iterator[Callable[[int, int, int], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    pace = Pace()
    with Progress(BarColumn(), TextColumn("{task.description}"), console=Console(stderr=True)) as progress:
        task = progress.add_task(label, total=None)

        def tell(done: int, of: int, failed: int) -> None:
            said = text(label, done, of, failed, *pace.at(done, of), words)
            progress.update(task, completed=done, total=of, description=said)

        yield tell

"""A progress bar on stderr where ``rich`` is installed and somebody is watching."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from .. import _terminal
from .._extras import present

T = TypeVar("T")


def track(items: Iterable[T], total: int, label: str, *, quiet: bool = False) -> Iterator[T]:
    """Yield the items, drawing a bar meanwhile."""
    if quiet or not watched():
        yield from items
        return
    from rich.console import Console
    from rich.progress import track as rich_track

    yield from rich_track(items, label, total=total, console=Console(stderr=True))


@contextmanager
def bar(label: str, *, quiet: bool = False) -> Iterator[Callable[[int, int], None]]:
    """Yield a function of steps done and steps in all, which draws a bar where somebody is watching."""
    if quiet or not watched():
        yield lambda done, of: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, of: progress.update(task, completed=done, total=of)


def say(*, quiet: bool = False) -> Callable[[str], None]:
    """Return a function that tells, on stderr, what a long run is at."""
    if quiet:
        return lambda text: None
    return _terminal.say


def watched() -> bool:
    """Whether a bar can be drawn, and somebody sees it."""
    return sys.stderr is not None and sys.stderr.isatty() and present("rich")

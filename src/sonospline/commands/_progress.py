"""A progress bar on stderr where ``rich`` is installed and somebody is watching."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

from .._extras import present

T = TypeVar("T")


def track(items: Iterable[T], total: int, label: str, *, quiet: bool = False) -> Iterator[T]:
    """Yield the items, drawing a bar meanwhile."""
    if quiet or not sys.stderr.isatty() or not present("rich"):
        yield from items
        return
    from rich.console import Console
    from rich.progress import track as rich_track

    yield from rich_track(items, label, total=total, console=Console(stderr=True))

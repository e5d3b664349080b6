"""A session that waits for its page to come back."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ..simulator.console import Console


class Kept(NamedTuple):
    """A session nobody is connected to."""

    scene: str
    console: Console

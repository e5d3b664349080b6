"""A session that waits for its page to come back."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .stage import Stage


class Kept(NamedTuple):
    """A session nobody is connected to."""

    scene: str
    stage: Stage

"""What has happened lately, in words: frames may be skipped, events may not."""

from __future__ import annotations

from collections.abc import Iterable

from ..contact.events import Held
from ..mechanics.bone_stop import Blocked
from .logged_event import Log, LoggedEvent

KEPT = 8
"""Events, at most."""
_LONGEST = 100
"""Characters of what a model of somebody else's calls an event."""


def logged(log: Log, events: Iterable[object], depth: float) -> Log:
    """Return a log with what has happened at a depth; that bone or tissue holds a needle is a state and none.

    Examples
    --------
    >>> from sonospline.contact import Touched
    >>> from sonospline.simulator.event_log import logged
    >>> logged((), [Touched("needle", "rib 11")], 31.25)
    (LoggedEvent(1, 'touched "rib 11"', 31.25 mm),)
    """
    for event in events:
        if not isinstance(event, Blocked | Held):
            number = log[-1].number + 1 if log else 1
            log = (*log, LoggedEvent(number, " ".join(str(event).split())[:_LONGEST], depth))
    return log[-KEPT:]

"""The trainer's door: a token of its own, and an end to guessing."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from typing import NamedTuple

from ..server.guard import same_token

MOST_GUESSES = 10
"""Wrong tokens from one address, after which no more are looked at from there for a while."""
LOCKED_S = 600.0
"""After the last of them, until they are forgotten."""
_MOST_ADDRESSES = 10_000
"""That have guessed; others are told that they are locked then, so that what is remembered has an end."""

WRONG = "the trainer's token is missing or wrong; open the address that was printed for the trainer at the start"
LOCKED = (
    f"{MOST_GUESSES} wrong tokens came from this address, and the trainer's page is locked for it; open the address "
    f"that was printed for the trainer at the start, or wait {LOCKED_S / 60:.0f} minutes"
)


class _Guesses(NamedTuple):
    number: int
    last_s: float


class Door:
    """Who may be the trainer.

    Who has the right token comes in whatever others have guessed: a page of any site can have the trainer's own browser
    send wrong ones, and behind a proxy all have one address.

    Parameters
    ----------
    token : str, optional
        By default one of 128 bits, which nobody guesses.
    now_s : callable
        The clock.

    Examples
    --------
    >>> from sonospline.course.door import Door
    >>> door = Door("chalk and sponge")
    >>> door.refusal("chalk and sponge", "127.0.0.1") is None
    True
    >>> door.refusal("open", "127.0.0.1")[:42]
    "the trainer's token is missing or wrong; o"
    """

    def __init__(self, token: str | None = None, *, now_s: Callable[[], float] = time.monotonic) -> None:
        self.token = secrets.token_urlsafe(16) if token is None else token
        self._now_s = now_s
        self._guesses: dict[str, _Guesses] = {}  # the oldest first

    def knows(self, given: str) -> bool:
        """Whether a token is the right one."""
        return bool(given) and same_token(given, self.token)

    def refusal(self, given: str, address: str) -> str | None:
        """Return why somebody is not let in, None where he is; no token at all is no guess."""
        if self.knows(given):
            return None
        if given and not self.locked(address):
            known = self._guesses.pop(address, None)
            self._guesses[address] = _Guesses(1 if known is None else known.number + 1, self._now_s())
        return LOCKED if self.locked(address) else WRONG

    def locked(self, address: str) -> bool:
        """Whether too many wrong tokens came from an address."""
        self._forget()
        known = self._guesses.get(address)
        return len(self._guesses) >= _MOST_ADDRESSES if known is None else known.number >= MOST_GUESSES

    def _forget(self) -> None:
        """What was guessed long ago."""
        while self._guesses:
            address, guesses = next(iter(self._guesses.items()))
            if self._now_s() - guesses.last_s < LOCKED_S:
                return
            del self._guesses[address]

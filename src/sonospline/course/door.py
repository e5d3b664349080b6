"""The trainer's door: a token of its own, and an end to guessing."""

from __future__ import annotations

import secrets
from collections import Counter

from ..server.guard import same_token

MOST_GUESSES = 10
"""Wrong tokens from one address, after which nobody comes in from there until the server is started again."""
_MOST_ADDRESSES = 10_000
"""That have guessed; from others nobody comes in then, so that what is remembered has an end."""

WRONG = "the trainer's token is missing or wrong; open the address that was printed for the trainer at the start"
LOCKED = (
    f"{MOST_GUESSES} wrong tokens came from this address, and the trainer's page is locked for it; use another "
    "computer, or start the lab again"
)


class Door:
    """Who may be the trainer.

    Parameters
    ----------
    token : str, optional
        By default one that nobody guesses.

    Examples
    --------
    >>> from sonospline.course.door import Door
    >>> door = Door("chalk and sponge")
    >>> door.refusal("chalk and sponge", "127.0.0.1") is None
    True
    >>> door.refusal("open", "127.0.0.1")[:42]
    "the trainer's token is missing or wrong; o"
    """

    def __init__(self, token: str | None = None) -> None:
        self.token = secrets.token_urlsafe(16) if token is None else token
        self._guesses: Counter[str] = Counter()

    def refusal(self, given: str, address: str) -> str | None:
        """Return why somebody is not let in, None where he is; no token at all is no guess."""
        if self.locked(address):
            return LOCKED
        if given and same_token(given, self.token):
            del self._guesses[address]
            return None
        if given:
            self._guesses[address] += 1
        return LOCKED if self.locked(address) else WRONG

    def locked(self, address: str) -> bool:
        """Whether too many wrong tokens came from an address."""
        known = address in self._guesses or len(self._guesses) < _MOST_ADDRESSES
        return self._guesses[address] >= MOST_GUESSES if known else True

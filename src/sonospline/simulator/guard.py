"""Who may speak to the server: its own page, under its own name."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Guard:
    """The rules.

    Parameters
    ----------
    host : str
        The address the server is bound to.
    port : int
        Its port.
    token : str, optional
        What a page has to know; demanded of every session where it is set.

    Raises
    ------
    ValueError
        An address others can reach, without a token of at least 8 characters.

    Examples
    --------
    >>> from sonospline.simulator.guard import Guard
    >>> guard = Guard("127.0.0.1", 8765)
    >>> guard.refusal({"host": "127.0.0.1:8765", "origin": "http://127.0.0.1:8765"}, None) is None
    True
    >>> guard.refusal({"host": "127.0.0.1:8765", "origin": "http://evil.example"}, None)
    'Origin http://evil.example is not this page'
    """

    host: str
    port: int
    token: str | None = None

    def __post_init__(self) -> None:
        if self.host not in LOOPBACK and (self.token is None or len(self.token) < 8):
            raise ValueError(
                f"--host = {self.host} can be reached by others; give --token of at least 8 characters, "
                "or leave --host out"
            )

    def foreign_host(self, headers: Mapping[str, str]) -> str | None:
        """Return why a request's Host is not ours, None where it is."""
        host = headers.get("host", "")
        if self.host not in LOOPBACK:
            return None  # whatever name it is known by: the token keeps others out
        if host in {f"{name}:{self.port}" for name in ("127.0.0.1", "localhost", "[::1]")}:
            return None
        return f"Host {host[:80]} is not this server"

    def refusal(self, headers: Mapping[str, str], token: str | None) -> str | None:
        """Return why a WebSocket is not let in, None where it is; programs that are no browser send no Origin."""
        foreign = self.foreign_host(headers)
        if foreign:
            return foreign
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != headers.get("host"):
            return f"Origin {origin[:80]} is not this page"
        if self.token is not None and not hmac.compare_digest((token or "").encode(), self.token.encode()):
            return "the token is missing or wrong"
        return None

"""Who may speak to the server: its own page, under its own name."""

from __future__ import annotations

import hmac
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple
from urllib.parse import quote

LOOPBACK = ("127.0.0.1", "localhost", "::1")
SHORTEST_TOKEN = 8

_PORTS = {"http": 80, "https": 443}
_NAME = r"(?P<name>[a-z0-9_.-]+|\[[0-9a-f:.]+\])(?::(?P<port>[0-9]{1,5}))?"
_HOST = re.compile(_NAME, re.ASCII | re.IGNORECASE)
_ORIGIN = re.compile(f"(?P<scheme>https?)://{_NAME}", re.ASCII | re.IGNORECASE)


class _Site(NamedTuple):
    """A name and the port behind it."""

    name: str
    port: int


@dataclass(frozen=True)
class Guard:
    """The rules.

    A page is let in whose Origin is the Host it asks: no other site's page can claim that. The Host has to be a name of
    this machine's loopback, at any port: ``ssh -L`` may listen at another one. Such a name cannot be made to point here
    by a stranger's name server, as any other could; so other names take a token, which a stranger does not know.

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
        An address others can reach, without a token; a token of less than 8 characters, or one no page could send.

    Examples
    --------
    >>> from sonospline.server.guard import Guard
    >>> guard = Guard("127.0.0.1", 8765)
    >>> guard.refusal({"host": "127.0.0.1:8765", "origin": "http://127.0.0.1:8765"}, None) is None
    True
    >>> guard.refusal({"host": "localhost:9000", "origin": "http://localhost:9000"}, None) is None
    True
    >>> guard.refusal({"host": "127.0.0.1:8765", "origin": "http://evil.example"}, None)
    "Origin 'http://evil.example' is not this page; open http://127.0.0.1:8765/"
    """

    host: str
    port: int
    token: str | None = None

    def __post_init__(self) -> None:
        if self.token is None:
            if self.host not in LOOPBACK:
                raise ValueError(
                    f"--host = {self.host} can be reached by others; give --token of at least {SHORTEST_TOKEN} "
                    "characters, or leave --host out"
                )
            return
        if len(self.token) < SHORTEST_TOKEN:
            raise ValueError(
                f"--token has {len(self.token)} characters and can be guessed; give at least {SHORTEST_TOKEN}"
            )
        try:
            self.token.encode()
        except UnicodeEncodeError:
            raise ValueError(f"--token = {self.token!r} is no text a page could send; give other letters") from None

    @property
    def address(self) -> str:
        """Where the page is; a token is in it."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        query = "" if self.token is None else f"?token={quote(self.token, safe='')}"
        return f"http://{host}:{self.port}/{query}"

    def foreign_host(self, headers: Mapping[str, str]) -> str | None:
        """Return why a request's Host is not ours, None where it is."""
        if self.token is not None:
            return None  # whatever name it is known by: the token keeps others out
        host = headers.get("host", "")
        site = _site(_HOST.fullmatch(host), "http")
        if site is not None and site.name.strip("[]") in LOOPBACK:
            return None
        return (
            f"Host {host[:80]!r} is not this server; open {self.address}, or start it with --token to use other names"
        )

    def refusal(self, headers: Mapping[str, str], token: str | None) -> str | None:
        """Return why a WebSocket is not let in, None where it is; programs that are no browser send no Origin."""
        foreign = self.foreign_host(headers)
        if foreign:
            return foreign
        origin = headers.get("origin")
        if origin is not None and not _same_site(origin, headers.get("host", "")):
            return f"Origin {origin[:80]!r} is not this page; open {self._public_address}"
        if self.token is not None and not same_token(token or "", self.token):
            return "the token is missing or wrong; open the address the server printed at its start"
        return None

    @property
    def _public_address(self) -> str:
        return self.address.partition("?")[0]


def same_token(given: str, token: str) -> bool:
    """Compare in a time that tells nothing; what a request holds may be no text at all."""
    return hmac.compare_digest(given.encode(errors="surrogatepass"), token.encode())


def _same_site(origin: str, host: str) -> bool:
    """Return whether a page of an origin asks its own server."""
    parts = _ORIGIN.fullmatch(origin)
    if parts is None:
        return False
    scheme = parts["scheme"].lower()
    return _site(parts, scheme) == _site(_HOST.fullmatch(host), scheme)


def _site(parts: re.Match[str] | None, scheme: str) -> _Site | None:
    """Return what a matched name stands for; browsers leave the scheme's own port out."""
    if parts is None:
        return None
    return _Site(parts["name"].lower(), _PORTS[scheme] if parts["port"] is None else int(parts["port"]))

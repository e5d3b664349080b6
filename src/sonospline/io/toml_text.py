"""TOML texts from anywhere: parsed in bounded time, with one kind of error."""

from __future__ import annotations

import re
import tomllib
from typing import Any

MOST_PARTS = 8
"""Parts of a dotted key: the parser's time grows with their square."""
MOST_DEPTH = 16
"""Lists and tables in one another."""
_LONGEST_LINE = 200

# Texts and comments, left open or not; nothing here is tried twice, whatever the text.
_OPAQUE = re.compile(
    r'"""(?:[^\\"]++|\\.|"(?!""))*+(?:"{3,5}|\Z)'
    r"|'''(?:[^']++|'(?!''))*+(?:'{3,5}|\Z)"
    r'|"(?:[^"\\\n]++|\\.)*+"?'
    r"|'[^'\n]*+'?"
    r"|\#[^\n]*+",
    re.DOTALL,
)
_LONG_KEY = re.compile(r"\." + r"[^.=\[\]{},\n]*+\." * (MOST_PARTS - 1))
_BRACKETS = re.compile(r"[\[\]{}]")
_AT_LINE = re.compile(r"\(at line (\d+), column \d+\)")


class TomlError(ValueError):
    """A text that is not TOML, or goes beyond what is read of it; knows the line where there is one."""

    def __init__(self, problem: str, line: int | None) -> None:
        self.problem, self.line = problem, line
        super().__init__(problem if line is None else f"{problem} (at line {line})")


def loads(text: str) -> dict[str, Any]:
    """Return the table a text holds.

    Raises
    ------
    TomlError
        Not TOML, a key of more than 8 parts, more than 16 lists or tables in one another, or a number no computer
        reads.

    Examples
    --------
    >>> from sonospline.io.toml_text import loads
    >>> loads("[tissue]\\nnodes = 5000")
    {'tissue': {'nodes': 5000}}
    >>> loads(".".join("abcdefghi") + " = 1")
    Traceback (most recent call last):
        ...
    sonospline.io.toml_text.TomlError: a key has more than 8 parts; give fewer (at line 1)
    """
    _check_shape(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        at = _AT_LINE.search(str(error))
        line = int(at[1]) if at else text.count("\n") + 1
        raise TomlError(_short(str(error).partition(" (at")[0]), line) from None
    except ValueError:
        raise TomlError("a whole number has thousands of digits; give a number", None) from None


def _check_shape(text: str) -> None:
    """Refuse what the parser would take for ever on, or die of, before it sees it."""
    bare = _OPAQUE.sub(_without_content, text)
    key = _LONG_KEY.search(bare)
    if key is not None:
        raise TomlError(f"a key has more than {MOST_PARTS} parts; give fewer", _line(bare, key.start()))
    depth = 0
    for bracket in _BRACKETS.finditer(bare):
        depth += 1 if bracket[0] in "[{" else -1
        if depth > MOST_DEPTH:
            problem = f"more than {MOST_DEPTH} lists and tables are in one another; give fewer"
            raise TomlError(problem, _line(bare, bracket.start()))


def _without_content(found: re.Match[str]) -> str:
    return ("" if found[0][0] == "#" else "_") + "\n" * found[0].count("\n")


def _line(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_LINE else text[: _LONGEST_LINE - 3] + "..."

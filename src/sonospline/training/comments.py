"""Comments of a teacher on an attempt, in a file beside its recording."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from ..io.records import FieldError, Record, about, read

LONGEST_COMMENT = 500
_MOST = 200
_LARGEST = 1_000_000


class Comment(Record, frozen=True, kw_only=True):
    """What is said of a moment."""

    time_s: Annotated[float, about("since the attempt began, s", low=0, high=1e6)]
    text: Annotated[str, about("what is to be said", longest=LONGEST_COMMENT)]


class _File(Record, frozen=True, kw_only=True):
    comments: Annotated[tuple[Comment, ...], about("in the order of their times", longest=_MOST)]


def comments_file(recording: Path) -> Path:
    """Return where comments on an attempt are kept: ``attempt.comments.json`` beside ``attempt.mcap``."""
    return recording.with_suffix(".comments.json")


def read_comments(recording: Path) -> tuple[Comment, ...]:
    """Return the comments beside a recording, in the order of their times; none where there is no file.

    Raises
    ------
    ValueError
        The file holds something else.
    """
    path = comments_file(recording)
    if not path.is_file():
        return ()
    try:
        if path.stat().st_size > _LARGEST:
            raise ValueError(f"it has more than {_LARGEST:,} bytes")
        found: Any = read(_File, json.loads(path.read_bytes()))
    except (FieldError, ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"{path.name} holds no comments: {' '.join(str(error).split())[:120]}; move it away") from None
    return tuple(found.comments)


def add_comment(recording: Path, time_s: float, text: str) -> tuple[Comment, ...]:
    """Keep a comment beside a recording, and return all of them.

    Raises
    ------
    ValueError
        The text is empty or too long, there are 200 already, or the file there holds something else.
    OSError
        It cannot be written: what was there stays.
    """
    from ..io.writing import write_json  # a server listens before readers of volumes are loaded

    text = text.strip()
    if not 0 < len(text) <= LONGEST_COMMENT:
        raise ValueError(f"comment has {len(text)} letters; give 1 to {LONGEST_COMMENT}")
    before = read_comments(recording)
    if len(before) >= _MOST:
        raise ValueError(f"{comments_file(recording).name} has {_MOST} comments already; no more are kept")
    found = tuple(sorted([*before, Comment(time_s=time_s, text=text)], key=lambda one: one.time_s))
    write_json(comments_file(recording), {"comments": [{"time_s": one.time_s, "text": one.text} for one in found]})
    return found

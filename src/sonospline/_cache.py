"""The folder of results worth keeping between runs: written whole or not at all, read only where sound.

A kept file ends in a seal, a checksum of all before it: a damaged one is never parsed, whose parser might fail in any
way or, worse, not at all. The seal stands at the end so that NumPy still opens the file by itself.
"""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, TypeVar

T = TypeVar("T")

logger = logging.getLogger(__name__)

_SEAL = b"sonospline-sha256:"
_SEAL_LENGTH = len(_SEAL) + hashlib.sha256().digest_size
_PREFIX, _SURELY_DEAD_S = ".partial-", 24 * 3600.0


def place(*parts: str) -> Path | None:
    """Return where a result is kept, in ``SONOSPLINE_CACHE`` or the user's cache folder; None where there is neither.

    A user without a home folder, as in many containers, has none.
    """
    named = os.environ.get("SONOSPLINE_CACHE")
    try:
        folder = Path(named).expanduser() if named else _users_folder()
    except RuntimeError:  # no home
        if named:
            logger.warning("SONOSPLINE_CACHE = %r names a home folder that is not there; nothing is kept", named)
        return None
    return folder.joinpath(*parts) if named or folder.is_absolute() else None


def _users_folder() -> Path:
    from platformdirs import user_cache_path  # its import takes longer than that of the package

    return user_cache_path("sonospline", appauthor=False)


def digest(*parts: object) -> str:
    """Return a short name for what a result depends on, from the ``repr`` of each part."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def recall(file: Path | None, load: Callable[[IO[bytes]], T], what: str) -> T | None:
    """Return what ``load`` reads from a kept file; None where there is none.

    A file that is damaged, that cannot be read, or that ``load`` refuses is said in the log and counts as absent: its
    result is made anew.
    """
    try:
        if file is None or not file.is_file():  # a pipe of that name would be waited for
            return None
        with file.open("rb") as stream:
            _check_seal(stream)
            stream.seek(0)
            return load(stream)
    except Exception as error:  # whatever is wrong with a kept file, it must not end a run
        logger.warning("%s kept in %s cannot be used and will be made anew: %s", what, file, error)
        return None


def keep(file: Path | None, save: Callable[[IO[bytes]], Any], what: str) -> None:
    """Write a file by ``save`` and seal it, all of it or nothing; failing to is said in the log and no error."""
    if file is None:
        return
    partial: Path | None = None
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        _remove_dead(file.parent)
        with tempfile.NamedTemporaryFile(
            "w+b", dir=file.parent, prefix=_PREFIX, suffix=file.suffix, delete=False
        ) as stream:
            partial = Path(stream.name)
            save(stream)
            stream.flush()
            stream.seek(0)
            seal = _SEAL + hashlib.file_digest(stream, "sha256").digest()
            stream.seek(0, os.SEEK_END)
            stream.write(seal)
        partial.replace(file)
    except OSError as error:
        logger.warning("cannot keep %s in %s: %s", what, file.parent, error)
    finally:
        if partial is not None:
            with suppress(OSError):
                partial.unlink(missing_ok=True)


def _check_seal(stream: IO[bytes]) -> None:
    """Raise ValueError where a file does not end in the checksum of what comes before."""
    length = stream.seek(0, os.SEEK_END) - _SEAL_LENGTH
    stream.seek(max(length, 0))
    seal = stream.read()
    stream.seek(0)
    known = hashlib.sha256()
    while length > 0 and (chunk := stream.read(min(length, 1 << 20))):
        known.update(chunk)
        length -= len(chunk)
    if seal != _SEAL + known.digest():
        raise ValueError("it is damaged, or not of this version")


def _remove_dead(folder: Path) -> None:
    """Remove what runs that were killed left half-written; to write one takes seconds."""
    for partial in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if time.time() - partial.stat().st_mtime > _SURELY_DEAD_S:
                partial.unlink()

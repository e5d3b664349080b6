"""The folder of results worth keeping between runs: written whole or not at all, read only where sound."""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, TypeVar

T = TypeVar("T")

logger = logging.getLogger(__name__)


def folder() -> Path:
    """Return ``SONOSPLINE_CACHE``, or the user's cache folder."""
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sonospline"
    return Path(os.environ.get("SONOSPLINE_CACHE") or default)


def digest(*parts: object) -> str:
    """Return a short name for what a result depends on, from the ``repr`` of each part."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def recall(file: Path, load: Callable[[Path], T], what: str) -> T | None:
    """Return what ``load`` reads from a kept file; None where there is none.

    A file that cannot be read, or that ``load`` refuses with a ValueError, is said in the
    log and counts as absent: its result is made anew.
    """
    try:
        return load(file)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        logger.warning("%s kept in %s cannot be used and will be made anew: %s", what, file, error)
        return None


def keep(file: Path, save: Callable[[IO[bytes]], Any], what: str) -> None:
    """Write a file by ``save``, all of it or nothing; failing to is said in the log and no error."""
    partial: Path | None = None
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, suffix=file.suffix, delete=False) as stream:
            partial = Path(stream.name)
            save(stream)
        partial.replace(file)
    except OSError as error:
        if partial is not None:
            partial.unlink(missing_ok=True)
        logger.warning("cannot keep %s in %s: %s", what, file.parent, error)

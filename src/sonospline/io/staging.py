"""Output folders that are filled all at once or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def staged_folder(out: str | Path) -> Iterator[Path]:
    """Yield a temporary folder; on success its files move to ``out``, on failure nothing stays.

    Raises
    ------
    ValueError
        ``out`` cannot be made or written; said before any work is done.
    """
    out = Path(out)
    made = _first_missing(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".partial-", dir=out))
    except OSError as error:
        raise ValueError(f"out = {str(out)!r} cannot be written ({error.strerror}); choose another folder") from None
    try:
        yield staging
        for file in sorted(staging.iterdir()):
            file.replace(out / file.name)
    except BaseException:
        shutil.rmtree(made or staging, ignore_errors=True)
        raise
    staging.rmdir()


def _first_missing(path: Path) -> Path | None:
    """The topmost folder that making ``path`` would create."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    return missing[-1] if missing else None

"""Output folders that change all at once or not at all, whatever ends the run.

A run fills a hidden staging folder inside its output folder and publishes it at the end. No system call moves several
files at once among other people's (to exchange whole folders would move what is not ours, and fails on mount points),
but one can turn a link. So each final name first becomes a link to ``.partial-X/.live/name``, where ``.live`` leads to
hard links of the earlier files; then ``.live`` is turned to the new ones, in one step; then the new files replace the
links. Through the final names one reads the earlier set or the new one at every moment. A run that is killed half-way
leaves links that still read so, and the next run in that folder puts the files of that set in their place. Where the
file system has no links, the earlier summary leaves first and the new one comes last.

A staging folder holds a lock (``flock``) that ends with its process and is seen in every container of one kernel; its
name says which kernel. What a dead run left is removed by the next one: at once where the lock is free and the kernel
is this one; elsewhere (another machine on a shared disk, or before a reboot, where a lock may not be seen) only where
the folder is also a week old.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import platform
import secrets
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from os import PathLike
from pathlib import Path

if sys.platform != "win32":
    import fcntl

_PREFIX = ".partial-"
_LIVE, _EARLIER, _NEW = ".live", ".earlier", "."
"""In a staging folder: the link that decides, and what it may lead to."""
_NO_LINKS = {errno.EPERM, errno.EACCES, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EXDEV, errno.EMLINK}
_SURELY_DEAD_S = 7 * 24 * 3600.0
_TRIES, _PAUSE_S = 100, 0.01


@contextmanager
def staged_folder(out: str | PathLike[str], *, summary: str = "summary.json") -> Iterator[Path]:
    """Yield a temporary folder; on success its files replace the earlier set in ``out``, on failure nothing stays.

    Parameters
    ----------
    out : str or Path
        The output folder; made, with its parents, where it is missing. Other files in it are left alone.
    summary : str, default: "summary.json"
        The file that describes the set. Where the earlier one names the same ``verb``, the ``files`` that it lists
        leave with it.

    Raises
    ------
    ValueError
        ``out`` cannot be made or written; said before any work is done.
    OSError
        The files cannot be published; the earlier set is back in place.

    Examples
    --------
    >>> import tempfile
    >>> from sonospline.io.staging import staged_folder
    >>> out = Path(tempfile.mkdtemp()) / "results"
    >>> with staged_folder(out) as folder:
    ...     _ = (folder / "summary.json").write_text("{}")
    >>> [file.name for file in out.iterdir()]
    ['summary.json']
    """
    out = Path(out)
    made: list[Path] = []
    staging = out / f"{_PREFIX}{_kernel()}-{secrets.token_hex(4)}"
    lock = None
    try:
        try:
            lock = _begin(staging, made)
            with _locked(out):
                _finish_dead_runs(out)
        except OSError as error:
            why = error.strerror or error
            raise ValueError(f"out = {str(out)!r} cannot be written ({why}); choose another folder") from None
        yield staging
        _publish(staging, summary)
    except BaseException:
        with suppress(OSError):
            _remove(staging)
        _remove_empty(made)
        raise
    finally:
        if lock is not None:
            os.close(lock)


def _begin(staging: Path, made: list[Path]) -> int | None:
    """Make and lock a staging folder; note the folders made for it, the innermost last."""
    for _ in range(_TRIES):  # until it is locked, another run's clean-up may take it, or an empty parent, away
        with suppress(FileNotFoundError, BlockingIOError):
            for folder in (*reversed(staging.parents), staging):
                if not folder.exists():
                    made.append(folder)  # before it is made: an interrupt may come between
                    folder.mkdir(exist_ok=True)
            lock = _try_lock(staging)
            if staging.exists():
                return lock
        time.sleep(_PAUSE_S)
    raise FileNotFoundError(errno.ENOENT, "it keeps being removed")


def _publish(staging: Path, summary: str) -> None:
    """Move everything in a staging folder to its final name, all at once, and remove the folder."""
    out = staging.parent
    new = sorted((file.name for file in staging.iterdir()), key=lambda name: (name == summary, name))
    for name in new:
        _sync(staging / name)
        if (out / name).is_dir():
            raise IsADirectoryError(f"{str(out / name)!r} is a folder where a file is to be written; move it away")
    with _locked(out):
        _finish_dead_runs(out)
        earlier = {*new, *_set_listed(out / summary, staging / summary)}
        try:
            if _keep_earlier(staging, [name for name in earlier if os.path.lexists(out / name)]):
                for name in sorted(earlier):
                    _turn(out / name, f"{staging.name}/{_LIVE}/{name}", staging)
                _turn(staging / _LIVE, _NEW, staging)
            else:
                (out / summary).unlink(missing_ok=True)
                for name in new:
                    (staging / name).replace(out / name)
        finally:
            _remove(staging)


def _keep_earlier(staging: Path, names: list[str]) -> bool:
    """Hold the earlier set by hard links and have ``.live`` lead to it; False where there are no links."""
    (staging / _EARLIER).mkdir()
    try:
        for name in names:
            os.link(staging.parent / name, staging / _EARLIER / name, follow_symlinks=False)
        (staging / _LIVE).symlink_to(_EARLIER)
    except (OSError, NotImplementedError) as error:
        if isinstance(error, OSError) and error.errno not in _NO_LINKS:
            raise
        return False
    return True


def _turn(link: Path, target: str, staging: Path) -> None:
    """Have a name be a link to a target, from one moment to the next."""
    fresh = staging / ".link"
    fresh.symlink_to(target)
    fresh.replace(link)


def _remove(staging: Path) -> None:
    """Remove a staging folder of this run or a dead one, once no final name leads into it any more."""
    out, live = staging.parent, staging / _LIVE
    if live.is_symlink():
        chosen = staging / live.readlink()
        for link in [file for file in out.iterdir() if _leads_into(file, staging)]:
            if os.path.lexists(chosen / link.name):
                (chosen / link.name).replace(link)
            else:  # the chosen set has no such file
                link.unlink()
    shutil.rmtree(staging, ignore_errors=True)  # its random name makes it one run's own; what it held is published


def _leads_into(file: Path, staging: Path) -> bool:
    return file.is_symlink() and str(file.readlink()).startswith(f"{staging.name}/{_LIVE}/")


def _finish_dead_runs(out: Path) -> None:
    """Remove what dead runs left, and settle the publications that a kill cut short; ``out`` is locked."""
    for staging in sorted(out.glob(f"{_PREFIX}*")):
        with suppress(OSError):  # alive, gone meanwhile, or another user's
            if _kernel() not in staging.name and time.time() - staging.stat().st_mtime < _SURELY_DEAD_S:
                continue
            lock = _try_lock(staging)
            if lock is None:
                continue
            try:
                _remove(staging)  # were its owner alive, the lock would be held
            finally:
                os.close(lock)


def _set_listed(earlier: Path, new: Path) -> list[str]:
    """Return the files that an earlier summary of the same verb lists: plain names beside it."""
    try:
        old, verb = json.loads(earlier.read_text()), json.loads(new.read_text())["verb"]
        listed = old["files"] if old["verb"] == verb else []
        return [name for name in listed if Path(name).name == name and (earlier.parent / name).is_file()]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []  # no summary of ours


def _sync(file: Path) -> None:
    """Bring a file to the disk; what a delayed write found out (a full disk, a quota) is an OSError here."""
    descriptor = os.open(file, os.O_RDWR)
    try:
        os.fsync(descriptor)
    except OSError as error:
        raise OSError(error.errno, f"{file.name} could not be written ({error.strerror}); make room for it") from None
    finally:
        os.close(descriptor)


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders that a run made, innermost first, as far as nobody put anything in them."""
    with suppress(OSError):
        for folder in reversed(folders):
            if folder.exists():
                folder.rmdir()


def _try_lock(folder: Path) -> int | None:
    """Return a descriptor that holds the folder's lock until it is closed; None where there are no locks.

    BlockingIOError where another process holds it.
    """
    if sys.platform == "win32":
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if isinstance(error, BlockingIOError):
            raise
        return None
    return descriptor


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold a folder's lock: two runs publish one after the other. Where it cannot be had, go on without."""
    if sys.platform == "win32":
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


@cache
def _kernel() -> str:
    """A short name of the kernel that runs: the same in all its containers, another after a reboot."""
    try:
        name = Path("/proc/sys/kernel/random/boot_id").read_text()
    except OSError:
        name = platform.node()
    return hashlib.sha256(name.encode()).hexdigest()[:8]

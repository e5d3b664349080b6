"""Files named by a user: ordinary ones, opened without waiting, read up to a bound."""

from __future__ import annotations

import codecs
import os
import stat
from os import PathLike
from pathlib import Path
from typing import BinaryIO

LONGEST_TEXT = 4 << 20
"""Bytes of a table or a parameter file, at most."""

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


def regular_file(path: str | PathLike[str], name: str, wanted: str) -> Path:
    """Return the path of an ordinary file.

    Parameters
    ----------
    path : path-like
        What the user named.
    name : str
        The argument, as an error names it.
    wanted : str
        What would be right, e.g. ``"a CSV file"``.

    Raises
    ------
    ValueError
        Nothing is there, or something that is no ordinary file: to open a pipe would wait for a writer.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{name} = {str(path)!r} does not exist; give {wanted}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"{name} = {str(path)!r} cannot be read ({reason}); give {wanted}") from None
    _refuse_other(path, mode, name, wanted)
    return path


def open_file(path: str | PathLike[str], name: str, wanted: str) -> BinaryIO:
    """Open an ordinary file to read its bytes; raises as :func:`regular_file` does."""
    path = regular_file(path, name, wanted)
    try:
        # Without waiting: what was a file a moment ago may be a pipe by now.
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except OSError as error:
        raise ValueError(f"{name} = {str(path)!r} cannot be read ({error.strerror}); give {wanted}") from None
    try:
        _refuse_other(path, os.fstat(number).st_mode, name, wanted)
        return os.fdopen(number, "rb")
    except BaseException:
        os.close(number)
        raise


def read_text(path: str | PathLike[str], name: str, wanted: str) -> str:
    """Return the text of a file: UTF-8 with or without a byte order mark, or UTF-16 with one.

    Raises
    ------
    ValueError
        As :func:`regular_file`; a file of more than 4 MiB; bytes that are not such text.
    """
    with open_file(path, name, wanted) as stream:
        try:
            content = stream.read(LONGEST_TEXT + 1)
        except OSError as error:
            raise ValueError(f"{name} = {str(path)!r} cannot be read ({error.strerror}); give {wanted}") from None
    if len(content) > LONGEST_TEXT:
        raise ValueError(f"{name} = {str(path)!r} has more than {LONGEST_TEXT:,} bytes; give {wanted}")
    encoding = next((encoding for mark, encoding in _MARKS if content.startswith(mark)), "utf-8")
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise ValueError(f"{name} = {str(path)!r} is not UTF-8 text ({error.reason}); give {wanted}") from None


def _refuse_other(path: Path, mode: int, name: str, wanted: str) -> None:
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "no ordinary file")
        raise ValueError(f"{name} = {str(path)!r} is {kind}; give {wanted}")

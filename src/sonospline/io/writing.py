"""Files that are whole under their name or not there: written beside it, read back, then moved.

A full disk, a quota or a limit on file sizes is seldom said: image libraries return as if all were well. So what was
written is read back to its last byte, against what was meant and by the checksums of its own format.
"""

from __future__ import annotations

import json
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .._extras import require
from .headers import SUFFIXES, read_header

_SILENCE = threading.Lock()
_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


def write_bytes(path: str | PathLike[str], data: bytes) -> None:
    """Write a file; OSError where not all of it arrives, and then ``path`` is as it was."""
    with beside(Path(path)) as partial:
        partial.write_bytes(data)
        if partial.read_bytes() != data:
            raise OSError("what was read back is not what was written")


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write a text as UTF-8, as :func:`write_bytes` does."""
    write_bytes(path, text.encode())


def write_json(path: str | PathLike[str], content: Any) -> None:
    """Write what JSON holds, as :func:`write_bytes` does."""
    write_text(path, json.dumps(content, indent=2) + "\n")


def write_image(image: Any, path: str | PathLike[str]) -> None:
    """Write a SimpleITK image, compressed where its format can be; OSError where not all of it arrives.

    Parameters
    ----------
    image : SimpleITK.Image
        Its voxels are compared with those in the file.
    path : path-like
        The suffix says the format. A header with its data in another file (.mhd, .nhdr) moves last.
    """
    sitk = require("SimpleITK")
    with beside(Path(path)) as partial:
        try:
            with _silence():
                sitk.WriteImage(image, str(partial), useCompression=True)
            _compare(partial, sitk.GetArrayViewFromImage(image))
        except (RuntimeError, EOFError, ValueError) as error:
            raise OSError(str(error).strip().splitlines()[-1]) from None


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield a path of the same name in a folder of its own; what is there in the end moves beside ``path``."""
    try:
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=path.parent, ignore_cleanup_errors=True) as folder:
            partial = Path(folder, path.name)
            yield partial
            for file in sorted(Path(folder).iterdir(), key=lambda file: file == partial):
                file.replace(path.with_name(file.name))
    except OSError as error:
        why = error.strerror or error
        raise OSError(f"{path.name} could not be written whole ({why}); make room, or choose another folder") from None


@contextmanager
def _silence() -> Iterator[None]:
    """Keep image libraries from telling the terminal what the exception, or the comparison, will say."""
    with _SILENCE:  # of two at once, the second would take the silence of the first for the terminal
        try:
            terminal = os.dup(2)
        except OSError:  # the process has no stderr
            yield
            return
        try:
            with Path(os.devnull).open("wb") as nowhere:
                os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)


def _compare(path: Path, voxels: Any) -> None:
    """Raise ValueError or EOFError where a file does not hold these voxels to the last byte."""
    meant, at, same = np.ascontiguousarray(voxels), 0, True
    if path.name.endswith(SUFFIXES):
        stored = meant.data.cast("B")
        for piece in read_header(path).payload.pieces(len(stored)):
            same = same and stored[at : at + len(piece)] == piece
            at += len(piece)
        same = same and at == len(stored)
    else:
        if path.suffix == ".png" and not path.read_bytes().endswith(_PNG_END):
            raise EOFError("it ends too early")
        sitk = require("SimpleITK")
        same = np.array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(path))), voxels)
    if not same:
        raise ValueError("what was read back is not what was written")

"""Where a data set's files are: a folder, or an address of fsspec; a file is whole under its name or not there."""

from __future__ import annotations

import os
import secrets
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from .._extras import require

PARTIAL = ".partial-"
"""Files of this beginning are being written, or were when somebody was killed."""
_AT_ONCE = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "memory", "oss"}
"""Protocols whose files appear whole."""


class StoreError(OSError):
    """A data set's files cannot be read or written: which, why, and what to do."""


class Store(ABC):
    """Files by their names, with ``/`` between folders.

    Parameters
    ----------
    address : str
        As people give it.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all.

        Raises
        ------
        StoreError
            It cannot be: a full disk, an object store that went away.
        """
        try:
            self._write(name, content)
        except Exception as error:  # what an object store raises is its own
            raise self._refusal(name, "written", error, "make room or bring it back, and run the same again") from None

    def read(self, name: str) -> bytes:
        """Return a file's content.

        Raises
        ------
        FileNotFoundError
            There is none.
        StoreError
            It cannot be read.
        """
        try:
            return self._read(name)
        except FileNotFoundError:
            raise FileNotFoundError(f"{self.address}: there is no {name}") from None
        except Exception as error:
            raise self._refusal(name, "read", error, "bring it back, and run the same again") from None

    def remove(self, name: str) -> None:
        """Remove a file; nothing happens where there is none."""
        try:
            self._remove(name)
        except FileNotFoundError:
            return
        except Exception as error:
            raise self._refusal(name, "removed", error, "bring it back, and run the same again") from None

    def names(self, folder: str) -> list[str]:
        """Return the names of the files in a folder, sorted; none where it is not there."""
        try:
            return sorted(name for name in self._names(folder) if PARTIAL not in name)
        except FileNotFoundError:
            return []
        except Exception as error:
            raise self._refusal(folder, "read", error, "bring it back, and run the same again") from None

    def holds(self, name: str) -> bool:
        """Return whether there is a file of that name."""
        return self.size(name) is not None

    @abstractmethod
    def size(self, name: str) -> int | None:
        """Return a file's size in bytes; None where there is none."""

    @abstractmethod
    def _write(self, name: str, content: bytes) -> None: ...

    @abstractmethod
    def _remove(self, name: str) -> None: ...

    @abstractmethod
    def _read(self, name: str) -> bytes: ...

    @abstractmethod
    def _names(self, folder: str) -> Iterator[str]: ...

    def remove_partial(self) -> None:
        """Remove what was half-written by somebody who is gone; object stores have nothing of the kind."""
        return

    def _refusal(self, name: str, done: str, error: Exception, remedy: str) -> StoreError:
        if isinstance(error, StoreError):
            return error
        why = " ".join(str(getattr(error, "strerror", None) or error or type(error).__name__).split())[:300]
        return StoreError(f"{self.address}: {name} cannot be {done} ({why}); {remedy}")


class Folder(Store):
    """A folder of this machine."""

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self.path = Path(address)

    def size(self, name: str) -> int | None:
        try:
            return (self.path / name).stat().st_size
        except OSError:
            return None

    def _write(self, name: str, content: bytes) -> None:
        final = self.path / name
        final.parent.mkdir(parents=True, exist_ok=True)
        partial = final.with_name(f"{PARTIAL}{secrets.token_hex(6)}")
        try:
            with partial.open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            partial.replace(final)
        except BaseException:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
            raise

    def _remove(self, name: str) -> None:
        (self.path / name).unlink()

    def _read(self, name: str) -> bytes:
        return (self.path / name).read_bytes()

    def _names(self, folder: str) -> Iterator[str]:
        for file in (self.path / folder).iterdir():
            if file.is_file():
                yield f"{folder}/{file.name}" if folder else file.name

    def remove_partial(self) -> None:
        for partial in self.path.rglob(f"{PARTIAL}*"):
            with suppress(OSError):
                partial.unlink()


class Remote(Store):
    """An address of fsspec, such as ``s3://bucket/folder`` or ``memory://folder``."""

    def __init__(self, address: str, options: dict[str, Any] | None = None) -> None:
        super().__init__(address)
        self._options = options or {}
        fsspec = require("fsspec")
        self._file_system, self._root = fsspec.core.url_to_fs(address, **self._options)
        protocol = self._file_system.protocol
        self._at_once = bool(_AT_ONCE & {protocol} if isinstance(protocol, str) else _AT_ONCE & set(protocol))

    def __getstate__(self) -> dict[str, Any]:
        return {"address": self.address, "options": self._options}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def size(self, name: str) -> int | None:
        try:
            return int(self._file_system.info(f"{self._root}/{name}")["size"])
        except FileNotFoundError:
            return None
        except Exception as error:
            raise self._refusal(name, "read", error, "bring it back, and run the same again") from None

    def _write(self, name: str, content: bytes) -> None:
        final = f"{self._root}/{name}"
        if self._at_once:
            self._file_system.pipe_file(final, content)
            return
        folder, _, last = final.rpartition("/")
        partial = f"{folder}/{PARTIAL}{secrets.token_hex(6)}-{last}"
        self._file_system.makedirs(folder, exist_ok=True)
        self._file_system.pipe_file(partial, content)
        self._file_system.mv(partial, final)

    def _remove(self, name: str) -> None:
        self._file_system.rm_file(f"{self._root}/{name}")

    def _read(self, name: str) -> bytes:
        found: bytes = self._file_system.cat_file(f"{self._root}/{name}")
        return found

    def _names(self, folder: str) -> Iterator[str]:
        place = f"{self._root}/{folder}".rstrip("/")
        self._file_system.invalidate_cache()
        for entry in self._file_system.ls(place, detail=True):
            if entry["type"] == "file":
                last = str(entry["name"]).rstrip("/").rpartition("/")[2]
                yield f"{folder}/{last}" if folder else last


def store_at(address: str | os.PathLike[str], options: dict[str, Any] | None = None) -> Store:
    """Return the store at an address: a folder, or what fsspec knows.

    Parameters
    ----------
    address : str or path
        A folder, or ``protocol://place``.
    options : dict, optional
        What fsspec is given for the protocol, such as ``{"endpoint_url": ...}``.

    Raises
    ------
    StoreError
        The protocol is not known, or needs a package that is not installed.
    """
    text = os.fspath(address)
    if "://" not in text or text.startswith("file://"):
        return Folder(text.removeprefix("file://"))
    try:
        return Remote(text.rstrip("/"), options)
    except (ValueError, ImportError, OSError) as error:
        raise StoreError(f"address = {text!r} cannot be used ({error}); give a folder, or s3://bucket/folder") from None

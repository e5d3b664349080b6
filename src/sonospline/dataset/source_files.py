"""The files that a scene is made of, and one hash of all that they hold, wherever they are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

from .._digest import digest, digest_of_bytes
from ..io.dicom_slices import frames_of, header_of, is_dicom
from ..io.headers import HeaderError, read_header
from ..io.labels import names_beside
from ..simulator.scene_file import SceneFile

_KEYS = ("file", "names", "ct", "materials")
"""Of a scene's tissue: what names a file."""
_DETACHED = (".mhd", ".nhdr")


def files_of(scene: SceneFile, folder: Path) -> dict[str, list[Path]]:
    """Return every file that is read of a scene by the key that names it, seen from a folder."""
    part = scene.tissue
    named = {key: folder / getattr(part, key) for key in _KEYS if getattr(part, key) is not None}
    found = {key: list(_of_image(path) if key in ("file", "ct") else [path]) for key, path in named.items()}
    if part.source == "labels" and part.names is None:
        beside = names_beside(named["file"])
        found["names"] = [beside] if beside.exists() else []
    return found


def hash_of(scene: SceneFile, folder: Path) -> str:
    """Return a hash of a scene and of every file it is made of: of what they hold, not of what they are called.

    Raises
    ------
    ValueError
        A file that is not there or cannot be read.
    """
    said = msgspec.to_builtins(scene)
    contents = {key: [_hash(key, path) for path in paths] for key, paths in files_of(scene, folder).items()}
    said["tissue"] |= dict.fromkeys(_KEYS)
    return digest(msgspec.json.encode(said, order="sorted").decode(), contents)


def _of_image(path: Path) -> Iterator[Path]:
    """An image, and what else holds voxels of it: another file of its header, other slices of its series."""
    if path.is_dir():
        yield from sorted(file for file in path.rglob("*") if file.is_file())
        return
    yield path
    if path.suffix.lower() in _DETACHED and path.is_file():
        try:
            yield read_header(path).payload.path
        except HeaderError:
            return  # who reads the image says what is wrong with it
    elif path.is_file() and is_dicom(path) and not _has_all_frames(path):
        yield from sorted(file for file in path.parent.iterdir() if file.is_file() and file != path)


def _has_all_frames(path: Path) -> bool:
    header = header_of(path)
    return header is None or frames_of(header) > 1


def _hash(key: str, path: Path) -> str:
    try:
        return digest_of_bytes(path.read_bytes())
    except OSError as error:
        why = error.strerror or type(error).__name__
        raise ValueError(f"{key} = {str(path)!r} cannot be read ({why}); bring it back, under this path") from None

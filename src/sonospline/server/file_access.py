"""Which files a scene that comes through a page may read: ordinary ones of the folder the server was started in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..io.dicom_slices import is_dicom
from ..io.files import regular_file
from ..io.headers import HeaderError, read_header
from ..io.labels import names_beside
from ..io.volumes import suffix_of
from ..simulator.scene_file import SceneFile, TissuePart

_IMAGES = ("file", "ct")
_TABLES = ("names", "materials")


def refuse_elsewhere(spec: SceneFile) -> None:
    """Refuse a scene that would read anything but ordinary files inside the present folder.

    A link is followed, and so is an image's header that has its voxels in another file.

    Raises
    ------
    ValueError
        Which key names it.
    """
    here = Path().resolve()
    for key, path in _named(spec.tissue):
        _check(here, key, path)
        if key in _IMAGES:
            _refuse_dicom(key, path)
            _check(here, key, _voxels_of(path, key))


def _named(tissue: TissuePart) -> Iterator[tuple[str, Path]]:
    """Yield every file a scene names, and the table beside a label map."""
    for key in (*_IMAGES, *_TABLES):
        named = getattr(tissue, key)
        if named is not None:
            yield key, Path(named)
    if tissue.source == "labels" and tissue.file is not None and tissue.names is None:
        beside = names_beside(tissue.file)
        if beside.exists():
            yield "names", beside


def _check(here: Path, key: str, path: Path) -> None:
    try:
        inside = (here / path).resolve().is_relative_to(here)
    except (ValueError, OSError, RuntimeError) as error:  # no path at all, or links in a circle
        raise ValueError(f"tissue.{key} = {str(path)!r} cannot be read ({error}); give a file") from None
    if not inside:
        raise ValueError(
            f"tissue.{key} = {str(path)!r} lies outside the folder the server was started in; start it with --scene"
        )
    regular_file(path, f"tissue.{key}", "a file")


def _refuse_dicom(key: str, path: Path) -> None:
    """Refuse a slice: those that belong to it may lie elsewhere."""
    if is_dicom(path):
        raise ValueError(f"tissue.{key} = {str(path)!r} is DICOM; start the server with --scene, or save it as .nrrd")


def _voxels_of(path: Path, key: str) -> Path:
    """Return where an image has its voxels; in itself where its header is none, which its reader will say."""
    try:
        suffix_of(path)
        return read_header(path, f"tissue.{key}").payload.path
    except (HeaderError, ValueError):
        return path

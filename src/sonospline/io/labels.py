"""The one reader of label maps, and the file of their names."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

from ..geometry.label_map import LARGEST, LabelMap, looks_like_labels
from ..geometry.volume import Volume
from .dicom_slices import is_dicom
from .segmentation import SUFFIX, names_segments, segmentation_of
from .tables import read_names
from .volumes import read_image, read_volume, suffix_of

logger = logging.getLogger(__name__)


def read_labels(
    path: str | PathLike[str],
    *,
    names: str | PathLike[str] | Mapping[int, str] | None = None,
    largest: int = LARGEST,
) -> LabelMap:
    """Read a label map and the names of its labels.

    Parameters
    ----------
    path : path-like
        A file :func:`~sonospline.io.volumes.read_volume` reads, of whole numbers: stored as integers, or as
        anything that is within 1e-3 of one once the file's scale is applied.
    names : path-like or mapping of int to str, optional
        A CSV with the columns ``label`` and ``name``, or the names themselves; by default the file beside the
        image with its name and ``.csv`` for its suffix, where there is one, else the segments of a ``.seg.nrrd`` or of
        a segmentation in DICOM, whose layers become one label map: where segments overlap, the later one is there.
    largest : int, default: 65535
        Largest label allowed.

    Raises
    ------
    ValueError
        A file that cannot be read, or a voxel that is not a whole number 0 to ``largest``. A file beside the
        image that is no table of names is left alone, with a warning.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import sonospline as ss
    >>> from sonospline.io.volumes import write_volume
    >>> from sonospline.geometry.volume import Volume
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_volume(Volume(voxels=np.full((4, 4, 4), 4.9999995), spacing=(1, 1, 1)), folder + "/organs.nrrd")
    ...     _ = Path(folder, "organs.csv").write_text("label,name\\n5,liver\\n")
    ...     ss.read_labels(folder + "/organs.nrrd").names
    {5: 'liver'}
    """
    where = f"labels = {str(path)!r}"
    found: Volume | None = None
    if names is None and is_segmentation(path) and not names_beside(path).is_file():
        found = segments_of(path)
    if found is None:
        found = read_volume(path, name="labels")
    labels = LabelMap.of(found, name=where, largest=largest)
    own = found.names if isinstance(found, LabelMap) else {}
    return labels.named(_names_beside(Path(path), own) if names is None else _given(names))


def is_segmentation(path: str | PathLike[str]) -> bool:
    """Return whether a file is a segmentation of 3D Slicer by its name."""
    return str(path).lower().endswith(SUFFIX)


def segments_of(path: str | PathLike[str]) -> LabelMap | None:
    """Return the segments of a segmentation as one label map; None where it names none, as a mere label map."""
    image = read_image(Path(path), "labels")
    return segmentation_of(image, f"labels = {str(path)!r}").labels() if names_segments(image) else None


def names_for(labels: LabelMap, path: str | PathLike[str], named: str | PathLike[str] | None) -> dict[int, str]:
    """Return the names of a label map that was read from a file: those given, beside it, or of its segments.

    Raises
    ------
    ValueError
        There are none.
    """
    if named is None and labels.names and (is_segmentation(path) or is_dicom(Path(path))):
        return dict(labels.names)
    return read_names(names_of(path, named), "label names")


def _given(names: str | PathLike[str] | Mapping[int, str]) -> Mapping[int, str]:
    return names if isinstance(names, Mapping) else read_names(names)


def _names_beside(path: Path, own: Mapping[int, str]) -> Mapping[int, str]:
    """The names in the table beside an image, else its own; none where the file there is no table."""
    beside = names_beside(path)
    if not beside.is_file():
        return own
    try:
        return read_names(beside)
    except ValueError as error:
        logger.warning("the labels have no names: %s", error)
        return {}


@contextmanager
def labels_named(path: str | PathLike[str]) -> Iterator[None]:
    """Name the file in whatever is wrong with its labels: one has no name, or its tissue no properties."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"labels = {str(path)!r}: {error}") from None


def warn_of_labels(volume: Volume, path: str | PathLike[str], what: str) -> None:
    """Say, once and in one line, that an image seems to be a label map, and what becomes of it."""
    if looks_like_labels(volume):
        logger.warning("volume = %r seems to be a label map, %s", str(path), what)


def names_beside(path: str | PathLike[str]) -> Path:
    """Return where the names of a label map's labels are by default: beside it, its name with ``.csv`` for its suffix.

    Raises
    ------
    ValueError
        A path that is no image's.

    Examples
    --------
    >>> from sonospline.io.labels import names_beside
    >>> names_beside("patient.01.nii.gz").name
    'patient.01.csv'
    """
    path = Path(path)
    if is_dicom(path):
        return path.with_name((path.name if path.is_dir() else path.stem) + ".csv")
    return path.with_name(path.name[: -len(suffix_of(path))] + ".csv")


def names_of(path: str | PathLike[str], named: str | PathLike[str] | None) -> Path:
    """Return the file of a label map's names: the one given, else the one beside it.

    Raises
    ------
    ValueError
        None was given and none is there.
    """
    if named is not None:
        return Path(named)
    beside = names_beside(path)
    if beside.exists():
        return beside
    inside = " (it names no segments)" if is_segmentation(path) else ""
    raise ValueError(f"labels = {str(path)!r} has no {beside.name} beside it; give the names of its labels{inside}")

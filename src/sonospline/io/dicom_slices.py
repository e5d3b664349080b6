"""What DICOM files say of their slices: of one image a file, of many in one (enhanced multi-frame), of segments."""

from __future__ import annotations

import logging
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._extras import require

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

_SUFFIXES = (".dcm", ".ima")
_MAGIC, _MAGIC_AT = b"DICM", 128
_DEFLATED = "1.2.840.10008.1.2.1.99"
"""Deflated Explicit VR Little Endian."""
_DIRECTORY = "1.2.840.10008.1.3.10"
"""Media Storage Directory Storage, a DICOMDIR."""
_MOST_FILES = 50_000
_ROUNDED = 5e-3
"""Of a direction's cosines, between slices of one orientation."""
_HEADER = (
    "SOPClassUID", "SeriesInstanceUID", "SeriesDescription", "SeriesNumber", "Modality", "Rows", "Columns",
    "NumberOfFrames", "SamplesPerPixel", "ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing",
    "SpacingBetweenSlices", "SliceThickness", "PhotometricInterpretation", "RescaleSlope", "RescaleIntercept",
    "SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence",
    "SegmentSequence", "SegmentationType", "MaximumFractionalValue",
)  # fmt: skip
REMEDY = "load it in 3D Slicer and save it as .nrrd"


class Slice(NamedTuple):
    """One slice, as its file has it: LPS mm."""

    file: Path
    frame: int
    position: Array
    """(3,) the centre of its first pixel."""
    axes: Array
    """(2, 3) where columns and where rows count to."""
    spacing: tuple[float, float]
    """From row to row, from column to column."""
    shape: tuple[int, int]
    """Rows, columns."""
    scale: tuple[float, float]
    """Slope and intercept of its values."""
    segment: int
    """Of a segmentation, which segment; else 0."""
    between: float
    """From slice to slice, where it says that; else 0."""
    thickness: float
    """0 where it does not say that."""


class Series(NamedTuple):
    """Slices of one series, one size and one orientation."""

    name: str
    slices: list[Slice]
    header: Any


def is_dicom(path: Path) -> bool:
    """Return whether a path is taken for DICOM: a folder, a file of its suffixes, or one that begins as they do."""
    try:
        if path.is_dir() or path.suffix.lower() in _SUFFIXES:
            return True
        if path.suffix and not path.suffix[1:].isdigit():
            return False
        return path.is_file() and _begins_as_one(path)
    except (OSError, ValueError):  # a name that is too long, or holds a zero, is none
        return False


def series_of(path: Path, where: str) -> Series:
    """Return the series that a path names: that of a file, or of a folder the one with most slices; others are named.

    Raises
    ------
    ValueError
        There is none with two slices or more in space.
    """
    own = None
    if path.is_dir():
        files = _files(path, where)
    else:
        own = header_of(path)
        if own is None:
            raise ValueError(f"{where} is no DICOM file that can be read; give an image in DICOM, or {REMEDY}")
        files = [path] if frames_of(own) > 1 else _files(path.parent, where, deep=False)
    found = _all_series(files, None if own is None else _uid(own), where)
    found.sort(key=lambda series: (-len(series.slices), series.name))
    if not found or len(found[0].slices) < 2:
        what = "a DICOM series of two slices or more that say where they are"
        if path.is_dir():
            raise ValueError(f"{where} is a folder; give one with {what}, or an image file")
        raise ValueError(f"{where} is not of {what}; give one, or {REMEDY}")
    if len(found) > 1:
        taken, *others = (f"{one.name} ({len(one.slices)} slices)" for one in found)
        left = ", ".join(others[:3]) + (", ..." if len(others) > 3 else "")
        logger.warning("%s holds %d series: %s is taken, not %s; name a file of another to take that",
                       where, len(found), taken, left)  # fmt: skip
    if found[0].header.get("PhotometricInterpretation") == "MONOCHROME1":
        raise ValueError(f"{where} has its white at the least value (MONOCHROME1), or is so shown alone; {REMEDY}")
    return found[0]


def _begins_as_one(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(_MAGIC_AT + len(_MAGIC))[_MAGIC_AT:] == _MAGIC


def _files(folder: Path, where: str, *, deep: bool = True) -> list[Path]:
    """Files of a folder, and of folders in it; what is hidden left out."""
    found: list[Path] = []
    for count, file in enumerate(folder.rglob("*") if deep else folder.iterdir()):
        if count > _MOST_FILES:
            raise ValueError(f"{where} holds more than {_MOST_FILES:,} files; give the folder of one series")
        if not any(part.startswith(".") for part in file.relative_to(folder).parts) and file.is_file():
            found.append(file)
    return sorted(found)


def header_of(file: Path) -> Any | None:
    """What a file says, without its pixels; None of one that is not DICOM, or is cut before them."""
    pydicom = require("pydicom")
    try:
        with warnings.catch_warnings(), file.open("rb") as stream:
            warnings.simplefilter("ignore")
            header = pydicom.dcmread(stream, stop_before_pixels=True, specific_tags=list(_HEADER))
            return header if _is_whole(header, stream) else None
    except Exception:  # of a file that is anything
        return None


def _is_whole(header: Any, stream: BinaryIO) -> bool:
    """Whether a file says what it is and, where that is an image, pixels follow."""
    kind, announced = header.get("SOPClassUID"), header.file_meta.get("MediaStorageSOPClassUID")
    if kind is None or announced is None:
        return kind is not None or announced == _DIRECTORY
    is_image = any(f"{what} Storage" in one.name for what in ("Image", "Segmentation") for one in (kind, announced))
    deflated = header.file_meta.get("TransferSyntaxUID") == _DEFLATED  # is read whole
    return not is_image or deflated or stream.read(1) != b""


def _all_series(files: list[Path], uid: str | None, where: str) -> list[Series]:
    """All that the files hold, of one series alone where its UID is given."""
    found: dict[tuple[str, tuple[int, int]], list[Series]] = defaultdict(list)
    for file in files:
        header = header_of(file)
        if header is None and _begins_as_one(file):
            raise ValueError(f"{where}: {file.name} is cut or damaged; copy it anew, or take it out of its folder")
        if header is None or (uid is not None and _uid(header) != uid):
            continue
        for slice_ in _slices(file, header):
            known = found[_uid(header), slice_.shape]
            same = next((one for one in known if _parallel(one.slices[0], slice_)), None)
            if same is None:
                known.append(same := Series(_name(header), [], header))
            same.slices.append(slice_)
    return [series for known in found.values() for series in known]


def frames_of(header: Any) -> int:
    """How many frames a file has."""
    return int(header.get("NumberOfFrames", 1) or 1)


def _uid(header: Any) -> str:
    return str(header.get("SeriesInstanceUID", ""))


def _parallel(one: Slice, other: Slice) -> bool:
    return bool(np.abs(one.axes - other.axes).max() < _ROUNDED)


def _name(header: Any) -> str:
    text = str(header.get("SeriesDescription", "") or f"series {header.get('SeriesNumber', '?')}")
    return f"{header.get('Modality', '?')} {text[:40]!r}"


def _slices(file: Path, header: Any) -> list[Slice]:
    """The slices of a file that say where they are; those of no grey image are none."""
    try:
        if int(header.get("SamplesPerPixel", 1)) != 1:
            return []
        shape = (int(header.Rows), int(header.Columns))
        return [_slice(file, header, number, shape) for number in range(frames_of(header))]
    except Exception:  # whatever a header leaves out, or holds instead
        return []


def _slice(file: Path, header: Any, number: int, shape: tuple[int, int]) -> Slice:
    said = _Said(header, number)
    rows, columns = (float(x) for x in said("PixelMeasuresSequence", "PixelSpacing"))
    axes = np.array(said("PlaneOrientationSequence", "ImageOrientationPatient"), float).reshape(2, 3)
    position = np.array(said("PlanePositionSequence", "ImagePositionPatient"), float)
    slope, intercept = (
        float(said("PixelValueTransformationSequence", name, default))
        for name, default in (("RescaleSlope", 1), ("RescaleIntercept", 0))
    )
    segment = int(said("SegmentIdentificationSequence", "ReferencedSegmentNumber", 0))
    between, thickness = (
        abs(float(said("PixelMeasuresSequence", name, 0) or 0)) for name in ("SpacingBetweenSlices", "SliceThickness")
    )
    numbers = np.array([*position, *axes.ravel(), rows, columns, slope, intercept, between, thickness])
    if position.shape != (3,) or not np.isfinite(numbers).all() or min(rows, columns) <= 0:
        raise ValueError("a place that is none")
    return Slice(file, number, position, axes, (rows, columns), shape, (slope, intercept), segment, between, thickness)


class _Said:
    """What a file says of one frame: in the frame's groups, in those shared by all, or of itself."""

    def __init__(self, header: Any, frame: int) -> None:
        each = header.get("PerFrameFunctionalGroupsSequence") or []
        shared = header.get("SharedFunctionalGroupsSequence") or []
        self._groups = [*([each[frame]] if frame < len(each) else []), *shared[:1]]
        self._header = header

    def __call__(self, group: str, name: str, default: Any = None) -> Any:
        for groups in self._groups:
            item = groups.get(group)
            if item and item[0].get(name) is not None:
                return item[0].get(name)
        found = self._header.get(name, default)
        return default if found is None else found

"""Volumes and segments in DICOM: a folder of slices, or one file of many; from LPS to RAS."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _memory
from .._extras import require
from ..geometry.label_map import LabelMap
from ..geometry.volume import Volume
from .dicom_slices import REMEDY, Series, Slice, series_of
from .files import regular_file

Array = NDArray[np.float64]

_LPS_TO_RAS = np.array([-1.0, -1.0, 1.0])
_SQUARE = 1e-3
"""Cosine between rows and columns that is rounding."""
_UNEVEN = 0.05
"""Of the distance from slice to slice: how far one may be from its place."""
_SHIFTED = 2e-3
"""Of a slice's height over the first: how far it may be beside it."""
_SAME_MM, _ROUNDED_MM = 2e-3, 0.1
"""Files round places to 0.1 mm at worst."""
_SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
"""Segmentation Storage, and Label Map Segmentation Storage."""


class _Stack(NamedTuple):
    """Where slices are, one over the other."""

    places: NDArray[np.int64]
    """(n,) of each slice, counted from the lowest."""
    spacing: tuple[float, float, float]
    origin: Array
    direction: Array


def read_dicom_volume(path: Path, name: str = "volume") -> Volume:
    """Read a series of slices as a volume; segments as a :class:`LabelMap` with their names.

    Parameters
    ----------
    path : Path
        A folder, a slice of a series, or a file of many frames.
    name : str
        The argument, as an error names it.

    Raises
    ------
    ValueError
        No series; slices that are missing, twice there, unevenly apart or shifted (a tilted gantry); pixels that cannot
        be decoded; or more than fits in memory.
    """
    if not path.is_dir():
        regular_file(path, name, "an image in DICOM")
    where = f"{name} = {str(path)!r}"
    series = series_of(path, where)
    if str(series.header.get("SOPClassUID", "")) in _SEGMENTATIONS:
        return _labels(series, where)
    stack = _stack(where, series.slices, gaps=False)
    order = [series.slices[number] for number in np.argsort(stack.places)]
    rows, columns = order[0].shape
    _memory.refuse_beyond(8 * len(order) * rows * columns, f"{where}: its voxels", remedy="crop it")
    exact = all(
        slope == int(slope) and intercept == int(intercept) for slope, intercept in (one.scale for one in order)
    )
    voxels = np.empty((len(order), rows, columns), np.int32 if exact else np.float32)
    numbers = {(one.file, one.frame): k for k, one in enumerate(order)}
    for one, pixels in _pixels(order, where):
        slope, intercept = one.scale
        voxels[numbers[one.file, one.frame]] = pixels.astype(np.float64) * slope + intercept
    return _placed(_narrowed(voxels), stack)


def _labels(series: Series, where: str) -> LabelMap:
    """Segments by their numbers: where they overlap, the later one is there; slices that were left out are empty."""
    stack = _stack(where, series.slices, gaps=True)
    rows, columns = series.slices[0].shape
    shape = (int(stack.places.max()) + 1, rows, columns)
    _memory.refuse_beyond(4 * int(np.prod(shape)), f"{where}: its voxels", remedy="crop it")
    voxels = np.zeros(shape, np.uint16)
    half = float(series.header.get("MaximumFractionalValue", 1) or 1) / 2
    layers: dict[tuple[Path, int], int] = {
        (one.file, one.frame): int(k) for one, k in zip(series.slices, stack.places, strict=True)
    }
    for one, pixels in _pixels(sorted(series.slices, key=lambda each: each.segment), where):
        layer = voxels[layers[one.file, one.frame]]
        if one.segment:
            layer[pixels > half - 0.25] = one.segment
        else:
            np.copyto(layer, pixels, casting="unsafe")
    names = {
        int(item.SegmentNumber): str(item.get("SegmentLabel", f"segment {item.SegmentNumber}"))
        for item in series.header.get("SegmentSequence", [])
    }
    volume = _placed(voxels, stack)
    return LabelMap.of(volume, name=where).named({n: text for n, text in names.items() if n > 0})


def _placed(voxels: NDArray[Any], stack: _Stack) -> Volume:
    return Volume(
        voxels=voxels.transpose(2, 1, 0), spacing=stack.spacing, origin=stack.origin, direction=stack.direction
    )


def _narrowed(voxels: NDArray[Any]) -> NDArray[Any]:
    """Whole numbers as 16 bits where they fit, as most scanners have them."""
    if voxels.dtype == np.int32 and voxels.min() >= -(1 << 15) and voxels.max() < 1 << 15:
        return voxels.astype(np.int16)
    return voxels


def _stack(where: str, slices: list[Slice], *, gaps: bool) -> _Stack:
    """Order slices along their normal; refuse what is no lattice."""
    first = slices[0]
    across, down = (axis / np.linalg.norm(axis) for axis in first.axes)
    if abs(across @ down) > _SQUARE:
        raise ValueError(f"{where} has rows and columns that are not at right angles; {REMEDY}")
    if any(not np.allclose(one.spacing, first.spacing, rtol=1e-3) for one in slices):
        raise ValueError(f"{where} has pixels of several sizes; give a folder of one kind, or {REMEDY}")
    down -= (down @ across) * across
    down /= np.linalg.norm(down)
    normal = np.cross(across, down)
    positions = np.array([one.position for one in slices])
    heights = positions @ normal
    order = np.argsort(heights, kind="stable")
    step, places = _places(where, heights[order], sparse=first if gaps else None)
    _refuse_shifted(where, positions[order], normal)
    found = np.empty(len(slices), np.int64)
    found[order] = places
    rows, columns = first.spacing
    direction = (_LPS_TO_RAS * np.array([across, down, normal])).T
    return _Stack(found, (columns, rows, step), _LPS_TO_RAS * positions[order[0]], direction)


def _places(where: str, heights: Array, *, sparse: Slice | None) -> tuple[float, NDArray[np.int64]]:
    """The distance from slice to slice, and which each is; of ``sparse`` ones several are at one place or none."""
    apart = np.diff(heights)
    steps = apart[apart > _SAME_MM]
    if not len(steps):
        raise ValueError(f"{where} has all its slices at one place; give a 3-D image")
    if sparse is None:
        _refuse_gaps(where, apart, step := float(np.median(steps)))
    else:
        step = _said_step(where, float(steps.min()), sparse)
    places = np.rint((heights - heights[0]) / step)
    step = float((heights[-1] - heights[0]) / places[-1])
    if np.abs(heights - heights[0] - places * step).max() > _UNEVEN * step + _SAME_MM:
        each = f"{steps.min():.4g} to {steps.max():.4g} mm"
        raise ValueError(f"{where} has slices unevenly apart, {each}; resample it evenly, or {REMEDY}")
    return step, places.astype(np.int64)


def _said_step(where: str, least: float, frame: Slice) -> float:
    """The distance from slice to slice of segments, any of which may lack: ``least`` may be that of two that stay."""
    if 0 < frame.between < 1.5 * least:
        return frame.between
    if not frame.between and 0 < 1.5 * frame.thickness < least:
        raise ValueError(
            f"{where} has slices {frame.thickness:.4g} mm thick and {least:.4g} mm apart, and does not say which lack "
            f"between them (SpacingBetweenSlices); {REMEDY}"
        )
    return least


def _refuse_gaps(where: str, apart: Array, step: float) -> None:
    count = len(apart) + 1
    if apart.min() <= _SAME_MM:
        times = count / (1 + int((apart > _SAME_MM).sum()))
        what = f"{times:.3g} slices at one place (phases, echoes or repeats)"
        raise ValueError(f"{where} has {what}; give a folder of one of them")
    wide = int(np.argmax(apart))
    if apart[wide] > 1.5 * step:
        lacking = int(np.rint(apart / step).sum()) - len(apart)
        raise ValueError(
            f"{where} lacks {lacking} slice{'s' * (lacking > 1)}: after slice {wide + 1} of {count} the next is "
            f"{apart[wide]:.4g} mm away, others {step:.4g} mm; add what is missing, or {REMEDY}"
        )


def _refuse_shifted(where: str, positions: Array, normal: Array) -> None:
    """Refuse slices that are not straight over each other."""
    heights = (positions - positions[0]) @ normal
    aside = np.linalg.norm(positions - positions[0] - np.outer(heights, normal), axis=1)
    if (aside > _SHIFTED * heights + _ROUNDED_MM).any():
        worst = int(np.argmax(aside))
        angle = np.degrees(np.arctan2(aside[worst], heights[worst]))
        raise ValueError(
            f"{where} has slices shifted against each other by {angle:.3g} degrees (a tilted gantry); {REMEDY}, with "
            "its acquisition geometry regularized"
        )


def _pixels(slices: list[Slice], where: str) -> Iterator[tuple[Slice, NDArray[Any]]]:
    """Each slice with its stored values; a file is read once where its slices follow each other."""
    for file, group in groupby(slices, key=lambda one: one.file):
        frames = _frames(file, where)
        for one in group:
            if one.frame >= len(frames) or frames[one.frame].shape != one.shape:
                raise ValueError(f"{where}: {file.name} has other pixels than it says; it is cut or damaged")
            yield one, frames[one.frame]


def _frames(file: Path, where: str) -> NDArray[Any]:
    """Stored values, (n, rows, columns)."""
    pydicom = require("pydicom")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found: NDArray[Any] = pydicom.dcmread(file).pixel_array
    except Exception as error:  # whatever its decoders raise
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ValueError(f"{where}: the pixels of {file.name} cannot be decoded ({reason[:150]}); {REMEDY}") from None
    return found if found.ndim == 3 else found[None]

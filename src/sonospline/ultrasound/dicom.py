"""Ultrasound DICOM: frames, and the regions whose pixels have a size."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._extras import require
from .._shown import size
from ..io.files import regular_file
from .frame import Frame

_CENTIMETRES = 3
_TISSUE = 1


@dataclass(frozen=True)
class Region:
    """A calibrated part of the screen (PS3.3 C.8.5.5): 2-D tissue, with the size of its pixels."""

    left: int
    top: int
    right: int
    bottom: int
    spacing_mm: tuple[float, float]

    @property
    def window(self) -> tuple[slice, slice]:
        """Its rows and columns."""
        return slice(self.top, self.bottom + 1), slice(self.left, self.right + 1)

    def fits(self, rows: int, columns: int) -> bool:
        """Return whether it lies in a frame, to a pixel; if not, the frame was cropped or resized after calibration."""
        return 0 <= self.left < self.right <= columns and 0 <= self.top < self.bottom <= rows


@dataclass(frozen=True, eq=False)
class Clip:
    """Grey frames of an ultrasound file and their calibrated regions."""

    frames: NDArray[np.uint8]
    """(n, rows, columns)."""
    regions: tuple[Region, ...]
    frame_ms: float | None
    """Time from frame to frame, where the file says."""

    def frame(
        self,
        index: int = 0,
        *,
        image_to_reference: ArrayLike | None = None,
        probe_to_reference: ArrayLike | None = None,
        region: int = 0,
        spacing_mm: float | tuple[float, float] | None = None,
    ) -> Frame:
        """Return one frame's region on a plane, placed as :meth:`Frame.placed` does.

        Where ``spacing_mm`` stands in for its calibration, it is the whole frame.

        Raises
        ------
        ValueError
            No such frame or region; or, where ``spacing_mm`` is not given, a file without calibration or one
            whose region does not fit its frame.
        """
        if not 0 <= _validate.count("index", index, least=0) < len(self.frames):
            raise ValueError(
                f"index = {index} is beyond the {len(self.frames)} frames; give 0 to {len(self.frames) - 1}"
            )
        pixels = self.frames[index]
        if spacing_mm is None:
            chosen = self._calibrated(region)
            pixels, spacing_mm = pixels[chosen.window], chosen.spacing_mm
        return Frame.placed(
            pixels,
            spacing_mm=spacing_mm,
            image_to_reference=image_to_reference,
            probe_to_reference=probe_to_reference,
        )

    def _calibrated(self, number: int) -> Region:
        if not self.regions:
            raise ValueError("the file has no calibrated region; give spacing_mm, the size of a pixel in mm")
        if not 0 <= number < len(self.regions):
            raise ValueError(f"region = {number} is not there; give 0 to {len(self.regions) - 1}")
        region, (rows, columns) = self.regions[number], self.frames.shape[1:]
        if not region.fits(rows, columns):
            raise ValueError(
                f"region {number} (columns {region.left}-{region.right}, rows {region.top}-{region.bottom}) does not "
                f"fit the {columns} x {rows} frame, which was cropped or resized after calibration; give spacing_mm "
                f"({region.spacing_mm[0]:.4g} if it was cropped)"
            )
        return region

    def __repr__(self) -> str:
        every = "" if self.frame_ms is None else f" every {self.frame_ms:g} ms"
        frames, *shape = self.frames.shape
        return f"Clip({frames} frames of {size(shape)} pixels{every}, {len(self.regions)} regions)"


def read_dicom(path: str | PathLike[str]) -> Clip:
    """Read an ultrasound DICOM file, grey or coloured (whose brightness is kept). Needs the extra ``dicom``.

    Raises
    ------
    ValueError
        No such file, not DICOM, another modality than ultrasound, or pixels that cannot be decoded.
    """
    path = regular_file(path, "dicom", "the path of a DICOM file")
    pydicom = require("pydicom")
    try:
        dataset = pydicom.dcmread(path)
    except (pydicom.errors.InvalidDicomError, OSError, EOFError, ValueError) as error:
        raise ValueError(f"dicom = {str(path)!r} cannot be read ({error}); give an ultrasound DICOM file") from None
    modality = str(dataset.get("Modality", "none"))
    if modality not in ("US", "IVUS"):
        raise ValueError(f"dicom = {str(path)!r} has the modality {modality}; give an ultrasound file (US)")
    try:
        frames = _grey(dataset)
    except (AttributeError, NotImplementedError, RuntimeError, ValueError) as error:
        raise ValueError(f"dicom = {str(path)!r}: its pixels cannot be decoded ({error})") from None
    frame_ms = dataset.get("FrameTime")
    return Clip(frames, tuple(_regions(dataset)), None if frame_ms is None else float(frame_ms))


def _grey(dataset: Any) -> NDArray[np.uint8]:
    """The frames' brightness, (n, rows, columns)."""
    pixels = dataset.pixel_array
    if int(dataset.SamplesPerPixel) == 3:
        # pydicom hands out RGB; the weights are those of JPEG's Y
        pixels = np.rint(pixels @ np.array([0.299, 0.587, 0.114]))
    elif dataset.PhotometricInterpretation == "PALETTE COLOR":
        coloured = require("pydicom.pixels").apply_color_lut(pixels, dataset)
        pixels = np.rint(coloured[..., :3] @ np.array([0.299, 0.587, 0.114]) * (255 / np.iinfo(coloured.dtype).max))
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    return np.clip(pixels, 0, 255).astype(np.uint8).reshape(-1, rows, columns)


def _regions(dataset: Any) -> list[Region]:
    found = []
    for item in dataset.get("SequenceOfUltrasoundRegions", ()):
        in_cm = item.get("PhysicalUnitsXDirection") == item.get("PhysicalUnitsYDirection") == _CENTIMETRES
        size = (10 * abs(float(item.get("PhysicalDeltaX", 0))), 10 * abs(float(item.get("PhysicalDeltaY", 0))))
        if in_cm and min(size) > 0 and item.get("RegionDataType") == _TISSUE:
            left, top = int(item.RegionLocationMinX0), int(item.RegionLocationMinY0)
            right, bottom = int(item.RegionLocationMaxX1), int(item.RegionLocationMaxY1)
            found.append(Region(left, top, right, bottom, size))
    return found

"""One rendered image: the picture, and the beams it is made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._shown import lengths, size
from ..geometry.bent_needle import BentNeedle
from ..geometry.needle import Needle
from .frame import Frame
from .optics import Optics


@dataclass(frozen=True, eq=False, repr=False)
class BMode:
    """One rendered image; a notebook shows its picture."""

    frame: Frame
    """The scan-converted picture, 8-bit, with its place in the world; masked outside the fan."""
    beams: NDArray[np.uint8]
    """(lines, samples) grey levels along the beams."""
    iq: NDArray[np.complex64]
    """(lines, samples) complex baseband, before compression."""
    optics: Optics

    @cached_property
    def envelope(self) -> NDArray[np.floating]:
        """(lines, samples) envelope over the rms of liver speckle at each depth (attenuation is in it)."""
        return np.abs(self.iq) / np.sqrt(self.optics.speckle_power).astype(np.float32)

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """(rows, columns) grey levels of the picture."""
        return self.frame.pixels

    def plot(self, ax: Any = None, *, needle: Needle | BentNeedle | None = None, **style: Any) -> Any:
        """Draw the picture in mm from the middle of the probe's face on matplotlib ``Axes``; return them."""
        return self.frame.plot(ax, needle=needle, **style)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the picture: .png, or .mha, .nrrd, ... with its pose; see :meth:`Frame.save`."""
        self.frame.save(path)

    def _repr_png_(self) -> bytes:
        return self.frame._repr_png_()

    def __repr__(self) -> str:
        picture = f"{size(self.frame.pixels.shape)} pixels of {lengths(self.frame.plane.spacing_mm)}"
        return f"BMode({picture}, {size(self.beams.shape)} samples)"

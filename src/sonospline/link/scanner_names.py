"""What a scanner on OpenIGTLink calls what it sends, and how often: a TOML file with the names of PLUS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from ..io import toml_text
from ..io.files import read_text
from ..io.records import FieldError, Record, about, read

Name = Annotated[str, about("Name of a device", longest=20)]


class ScannerNames(Record, frozen=True, kw_only=True):
    """Device names and rates of a :class:`Scanner`; each may be changed in a TOML file.

    Examples
    --------
    >>> from sonospline.link import ScannerNames
    >>> ScannerNames.parse('Image = "Image_Tracker"').Image
    'Image_Tracker'
    """

    Image: Name = "Image_Reference"
    Probe: Name = "ProbeToReference"
    Needle: Name = "NeedleToReference"
    NeedleTip: Name = "NeedleTipToReference"
    Target: Name = "TargetToReference"
    Force: Name = "NeedleForce"
    Events: Name = "Events"
    Readouts: Name = "Readouts"
    UsDevice: Name = "VideoDevice"
    Tracker: Name = "TrackerDevice"
    OutputChannel: Name = "OutputChannel"
    AcquisitionRate: Annotated[float, about("Frames a second", 1.0, 120.0)] = 30.0

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the names that a TOML text gives; ValueError for keys that are not known, or values out of range."""
        try:
            return read(cls, toml_text.loads(text))
        except FieldError as error:
            raise ValueError(f"names: {error}") from None

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Return the names that a TOML file gives."""
        return cls.parse(read_text(path, "names", "a TOML file"))

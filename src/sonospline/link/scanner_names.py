"""What a scanner on OpenIGTLink calls what it sends, and how often: a TOML file with the names of PLUS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np

from ..io import toml_text
from ..io.files import read_text
from ..io.records import LONGEST_LIST, FieldError, Record, about, read
from .transform_repository import frames_of

Name = Annotated[str, about("Name of a device", longest=20)]
Matrix = Annotated[tuple[float, ...], about("rows of a 4 x 4 matrix, mm", longest=16)]
Orientation = Literal["MF", "UF", "MN", "UN"]
ForceType = Literal["SENSOR", "STRING", "NDARRAY"]
ORIENTATIONS: tuple[Orientation, ...] = ("MF", "UF", "MN", "UN")


class CoordinateDefinition(Record, frozen=True, kw_only=True):
    """Where one coordinate system is in another, as in PLUS's CoordinateDefinitions: a calibration, a registration."""

    From: Annotated[str, about("a coordinate system, as NeedleTip", longest=20)]
    To: Annotated[str, about("another, as Needle", longest=20)]
    Matrix: Matrix

    def __post_init__(self) -> None:
        if len(self.Matrix) != 16:
            raise FieldError(("Matrix",), f"has {len(self.Matrix)} numbers; give the 16 of a 4 x 4 matrix, row by row")
        try:
            frames_of(self.name)
        except ValueError:
            raise FieldError(
                ("From",), f"= {self.From!r} and To are no coordinate systems; begin with a capital"
            ) from None

    @property
    def name(self) -> str:
        """As transforms are named: ``NeedleTipToNeedle``."""
        return f"{self.From}To{self.To}"

    @property
    def matrix(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        """(4, 4)."""
        return np.array(self.Matrix, float).reshape(4, 4)


class ScannerNames(Record, frozen=True, kw_only=True):
    """Device names, coordinate systems and rates of a :class:`Scanner`; each may be changed in a TOML file.

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
    Targets: Name = "Targets"
    Force: Name = "NeedleForce"
    Events: Name = "Events"
    Readouts: Name = "Readouts"
    UsDevice: Name = "VideoDevice"
    Tracker: Name = "TrackerDevice"
    OutputChannel: Name = "OutputChannel"
    AcquisitionRate: Annotated[float, about("Frames a second", 1.0, 120.0)] = 30.0
    MeshRate: Annotated[float, about("Meshes of the organs a second; 0 for none", 0.0, 60.0)] = 10.0
    ImageOrientation: Annotated[
        Orientation, about("where x and y of the pixels run: to the marked or unmarked side, far or near")
    ] = "MF"
    ForceTypes: Annotated[
        tuple[ForceType, ...], about("messages that carry the force; 3D Slicer reads STRING", longest=3)
    ] = ("SENSOR", "STRING")
    TransformNames: Annotated[
        tuple[Name, ...], about("more transforms to send, composed of those known", longest=LONGEST_LIST)
    ] = ()
    CoordinateDefinitions: Annotated[
        tuple[CoordinateDefinition, ...], about("calibrations and registrations", longest=LONGEST_LIST)
    ] = ()

    def __post_init__(self) -> None:
        tools = ("Probe", "Needle", "NeedleTip", "Target")
        references = []
        for key in (*tools, *(f"TransformNames[{k}]" for k in range(len(self.TransformNames)))):
            name = getattr(self, key, None) or self.TransformNames[int(key[15:-1])]
            try:
                frames = frames_of(name)
            except ValueError as error:
                raise FieldError((key,), f"= {name!r}: {error}") from None
            references += [frames[1]] if key in tools else []
        for key, reference in zip(tools, references, strict=True):
            if reference != references[0]:
                problem = f"is to {reference}, and Probe to {references[0]}; give all of them the same one"
                raise FieldError((key,), problem)

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

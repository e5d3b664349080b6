"""What a scanner on OpenIGTLink calls what it sends, and how often: a TOML file with the names of PLUS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from msgspec import structs

from ..io import toml_text
from ..io.files import read_text
from ..io.records import LONGEST_LIST, FieldError, Record, about, read
from ..tracking.transform_repository import frames_of

LONGEST_NAME = 20
"""Bytes that a message has for the name of its device."""
Name = Annotated[str, about("Name of a device", longest=LONGEST_NAME)]
Matrix = Annotated[tuple[float, ...], about("rows of a 4 x 4 matrix, mm", longest=16)]
Orientation = Literal["MF", "UF", "MN", "UN"]
ForceType = Literal["SENSOR", "STRING", "NDARRAY"]
ORIENTATIONS: tuple[Orientation, ...] = ("MF", "UF", "MN", "UN")
_DIFFER = (
    ("Probe", "Needle", "Target"), ("Probe", "NeedleTip", "Target"), ("Force", "Events", "Readouts"), ("Image",),
    ("Targets",), ("UsDevice", "Tracker"), ("OutputChannel",),
)  # fmt: skip
"""Every device; those in one group send the same type, so that only their names tell them apart."""


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


class TrackerDevice(Record, frozen=True, kw_only=True):
    """A server of OpenIGTLink that is listened to: a tracker, PLUS, 3D Slicer; as a Device is written for PLUS."""

    Id: Annotated[str, about("what to call it", longest=64)] = "TrackerDevice"
    ServerAddress: Annotated[str, about("its host", longest=255)] = "127.0.0.1"
    ServerPort: Annotated[int, about("its port", 1, 65_535)] = 18946
    ToolReferenceFrame: Annotated[str, about("what its poses are in", longest=20)] = "Tracker"
    Tools: Annotated[tuple[str, ...], about("coordinate systems that it tracks", longest=LONGEST_LIST)] = (
        "Probe", "Needle", "Reference",
    )  # fmt: skip
    MessageType: Annotated[Literal["TRANSFORM", "TDATA", "QTDATA"], about("how its poses come")] = "TRANSFORM"
    Unit: Annotated[Literal["mm", "m"], about("of its places")] = "mm"
    LatencySec: Annotated[float, about("how old a pose is when it comes; it is guessed ahead by that", 0.0, 0.1)] = 0.0
    HeaderVersion: Annotated[int, about("of what it is sent: 1 for servers that know no other", 1, 2)] = 2

    def __post_init__(self) -> None:
        for name in self.transforms:
            try:
                frames_of(name)
            except ValueError:
                raise FieldError(
                    ("Tools",), f"to {self.ToolReferenceFrame!r} give no transform; begin with capitals"
                ) from None
            if len(name) > LONGEST_NAME:
                raise FieldError(("Tools",), f"give {name}, which no message can carry; shorten it to {LONGEST_NAME}")

    @property
    def transforms(self) -> tuple[str, ...]:
        """The names of its poses."""
        return tuple(f"{tool}To{self.ToolReferenceFrame}" for tool in self.Tools)


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
        tuple[ForceType, ...], about("messages that carry the force; those but STRING to who asks", longest=3)
    ] = ("SENSOR", "STRING")
    TransformNames: Annotated[
        tuple[Name, ...], about("more transforms to send, composed of those known", longest=LONGEST_LIST)
    ] = ()
    CoordinateDefinitions: Annotated[
        tuple[CoordinateDefinition, ...], about("calibrations and registrations", longest=LONGEST_LIST)
    ] = ()

    Devices: Annotated[tuple[TrackerDevice, ...], about("trackers to listen to", longest=8)] = ()
    TargetPoint: Annotated[str, about("name of a fiducial that becomes the target", longest=64)] = "Target"
    EntryPoint: Annotated[str, about("name of one where the needle waits at the skin", longest=64)] = "Entry"

    def __post_init__(self) -> None:
        self._check_sources()
        self._check_devices()
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

    def with_tracker(self, address: str) -> Self:
        """Return them with one more tracker to listen to, given as ``host:port``.

        Raises
        ------
        ValueError
            An address that is none, or a tracker of the same transforms.
        """
        host, colon, port = address.rpartition(":")
        if not colon or not host or not port.isascii() or not port.isdigit() or not 1 <= int(port) <= 65_535:
            raise ValueError(f"tracker = {address!r} is no address; give host:port, as localhost:18946")
        device = TrackerDevice(Id=address[:64], ServerAddress=host.strip("[]"), ServerPort=int(port))
        return structs.replace(self, Devices=(*self.Devices, device))

    def _check_devices(self) -> None:
        for group in _DIFFER:
            keys: dict[str, str] = {}
            for key in group:
                name = getattr(self, key)
                if not name.isprintable() or not 1 <= len(name.encode()) <= LONGEST_NAME:
                    raise FieldError((key,), f"= {name!r} names no device; give 1 to {LONGEST_NAME} bytes of UTF-8")
                if keys.setdefault(name, key) != key:
                    raise FieldError((key,), f"= {name!r} is what {keys[name]} is called; give another name")
        known: set[frozenset[str]] = set()
        for number, one in enumerate(self.CoordinateDefinitions):
            known.add(frozenset((one.From, one.To)))
            if len(known) <= number:
                raise FieldError(
                    ("CoordinateDefinitions", number), f"gives {one.name} again; leave it out, or the one before"
                )

    def _check_sources(self) -> None:
        owners: dict[str, str] = {}
        for number, device in enumerate(self.Devices):
            for name in device.transforms:
                if name in owners:
                    problem = f"gives {name}, which {owners[name]} gives already; leave it out of one of them"
                    raise FieldError(("Devices", number, "Tools"), problem)
                owners[name] = device.Id
            if [one.Id for one in self.Devices].count(device.Id) > 1:
                raise FieldError(
                    ("Devices", number, "Id"), f"= {device.Id!r} is there twice; call one of them otherwise"
                )

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

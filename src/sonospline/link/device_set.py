"""PLUS's file for a link of ours."""

from __future__ import annotations

from ..tracking.plus_device_set import plus_device_set
from .coordinate_frames import CoordinateFrames
from .scanner_names import ScannerNames

FILE = "PlusDeviceSet_Sonospline.xml"


def device_set_of(names: ScannerNames, host: str, port: int) -> str:
    """Return the device set by which PlusServer takes images and poses from a link with these names.

    Of a link that listens at every address of its machine, it is one for PlusServer on that machine.
    """
    frames = CoordinateFrames(names)
    if host in ("", "0.0.0.0", "::"):
        host = "localhost"
    return plus_device_set(
        host=host, port=port, tools=(frames.probe, frames.needle, frames.tip), reference=frames.reference,
        rate=names.AcquisitionRate, orientation=names.ImageOrientation,
    )  # fmt: skip

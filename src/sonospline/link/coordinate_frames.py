"""The coordinate systems of a link: the simulator's, those on the wire, and what is between them."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from .._shown import shown
from ..geometry.pose import rigid
from ..tracking.transform_repository import TransformRepository, frames_of
from .scanner_names import CoordinateDefinition, ScannerNames

Array = NDArray[np.float64]

WORLD = "Ras"
"""The simulator's world, as SlicerIGT calls it: RAS mm."""
TRANSDUCER = "TransducerOrigin"
"""In the middle of the probe's face, as PLUS calls it."""
IMAGE, _PIXEL = "Image", "TransducerOriginPixel"


class CoordinateFrames:
    """Where tools are, by calibrations and the registration of the wire's reference to the simulator's world.

    What a file does not define is the same: the needle's tip and the needle, the middle of the probe's face and the
    probe, the reference and the world. PLUS's own calibration of a probe, ``ImageToProbe`` beside
    ``ImageToTransducerOriginPixel``, says where its face is.

    Parameters
    ----------
    names : ScannerNames

    Raises
    ------
    ValueError
        Definitions that contradict each other, or a tool's that is not rigid.
    """

    def __init__(self, names: ScannerNames) -> None:
        self.names = names
        self.probe, self.reference = frames_of(names.Probe)
        self.needle, self.tip = frames_of(names.Needle)[0], frames_of(names.NeedleTip)[0]
        self.known = TransformRepository()
        """The definitions, and what goes without saying."""
        given = {one.name: one.matrix for one in names.CoordinateDefinitions}
        calibration = _face_to_probe(given, self.probe)
        if calibration is not None:
            self.known.set(f"{TRANSDUCER}To{self.probe}", calibration)
        for name, matrix in given.items():
            if frames_of(name)[0] != IMAGE:  # of pixels, which are the simulator's own
                self.known.set(name, matrix)
        for source, target in ((self.tip, self.needle), (TRANSDUCER, self.probe), (self.reference, WORLD)):
            if source != target and self.known.way(source, target) is None:
                self.known.set(f"{source}To{target}", np.eye(4))
        self.tip_to_needle = self._rigid(self.tip, self.needle)
        self.face_to_probe = self._rigid(TRANSDUCER, self.probe)
        self.world_to_reference = self._rigid(WORLD, self.reference)
        self.reference_to_world = self._rigid(self.reference, WORLD)

    def _rigid(self, source: str, target: str) -> Array:
        return np.eye(4) if source == target else rigid(f"{source}To{target}", self.known.get(f"{source}To{target}"))

    def define(self, name: str, matrix: ArrayLike) -> None:
        """Give a definition anew, as PLUS's UpdateTransform does: ``NeedleTipToNeedle`` after a pivot calibration.

        Raises
        ------
        ValueError
            It is none of those that are known, or not rigid.
        """
        source, target = frames_of(name)
        if IMAGE in (source, target) or len(self.known.way(source, target) or ()) != 2:
            raise ValueError(
                f"{shown(name)} defines nothing here; give one of those that are known, as {self.tip}To{self.needle}"
            )
        others = [one for one in self.names.CoordinateDefinitions if {one.From, one.To} != {source, target}]
        rows = tuple(rigid(name, matrix).ravel().tolist())
        definition = CoordinateDefinition(From=source, To=target, Matrix=rows)
        made = CoordinateFrames(replace(self.names, CoordinateDefinitions=(*others, definition)))
        vars(self).update(vars(made))

    def points(self, world: NDArray[np.floating]) -> Array:
        """Return points (m, 3) of the world in the wire's reference."""
        return world @ self.world_to_reference[:3, :3].T + self.world_to_reference[:3, 3]

    def __repr__(self) -> str:
        return f"CoordinateFrames({self.needle}, {self.probe} in {self.reference})"


def _face_to_probe(given: dict[str, Array], probe: str) -> Array | None:
    """Where PLUS's calibration of an image has the middle of the probe's face, with the image's directions."""
    to_probe, to_pixel = given.get(f"{IMAGE}To{probe}"), given.get(f"{IMAGE}To{_PIXEL}")
    if to_probe is None or to_pixel is None:
        return None
    x, y, _ = to_probe[:3, :3].T
    pose = np.eye(4)
    pose[:3, 0] = x / np.linalg.norm(x)
    across = y - (y @ pose[:3, 0]) * pose[:3, 0]
    pose[:3, 1] = across / np.linalg.norm(across)
    pose[:3, 2] = np.cross(pose[:3, 0], pose[:3, 1])
    pose[:3, 3] = (to_probe @ np.linalg.inv(to_pixel)[:, 3])[:3]
    return pose

"""A scene of 3D Slicer that is ready for a link: connector, transforms, image in its slice, models, target, needle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import igtl
from ..geometry.needle_surface import STEEL, needle_surface
from ..io.mrml import FOUR_UP, GREY, Mrml, nrrd_bytes
from ..simulator.session import Session
from .coordinate_frames import WORLD, CoordinateFrames
from .frame_messages import messages_of
from .mesh_messages import device_name
from .needle_pose import waiting_pose
from .scanner_names import LONGEST_NAME, ScannerNames

Array = NDArray[np.float64]

_TRANSVERSE = "6"
"""Volume Reslice Driver's number for the plane that an image itself lies in."""


def slicer_scene(
    session: Session,
    names: ScannerNames | None = None,
    *,
    host: str = "localhost",
    port: int = 18944,
    drive: int | None = None,
    watch: str | None = None,
) -> Mrml:
    """Return a scene that shows what a link of this session sends, under the names that it sends.

    Parameters
    ----------
    session : Session
        Stepped once where it was not yet.
    names : ScannerNames, optional
    host, port : str, int
        Where its connector looks for the link.
    drive : int, optional
        A port where 3D Slicer is a tracker: three transforms that its user moves go out there, for
        ``sonospline link --tracker localhost:PORT``.
    watch : str, optional
        A model that SlicerIGT's Breach Warning guards from the needle's tip.

    Raises
    ------
    ValueError
        A model to watch that is not there, or tools to drive whose transforms no message can carry.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.link import slicer_scene
    >>> slicer_scene(ss.Session("gel", model="kelvinlet"), watch="vessel").text().count("<Model ")
    4
    """
    return _Builder(session, names or ScannerNames()).built(host, port, drive, watch)


class _Builder:
    """Puts a scene together from the messages of a session's frame."""

    def __init__(self, session: Session, names: ScannerNames) -> None:
        self._scene, self._names, self._frames = session.scene, names, CoordinateFrames(names)
        frame = session.step() if session.last is None else session.last
        messages = messages_of(frame, waiting_pose(session.scene), self._frames)
        self._sent = {one.device: one.content for one in messages}
        self._mrml = Mrml()
        self._needle_mm = session.scene.spec.needle.length_mm
        self._probe_mm = frame.probe.aperture_mm

    def built(self, host: str, port: int, drive: int | None, watch: str | None) -> Mrml:
        mrml, names = self._mrml, self._names
        root = {"transform": self._transform(f"{self._frames.reference}To{WORLD}", self._frames.reference_to_world)}
        poses = {
            name: self._transform(name, content.matrix, root)
            for name, content in self._sent.items()
            if isinstance(content, igtl.Transform)
        }
        image = self._image(root)
        models = self._models(root)
        models["NeedleModel"] = mrml.surface(
            "NeedleModel", *needle_surface(self._needle_mm), STEEL, 1.0, {"transform": poses[names.NeedleTip]}
        )
        models["ProbeModel"] = mrml.surface(
            "ProbeModel", *_box(self._probe_mm), "#9fb4c8", 0.8, {"transform": poses[names.Probe]}
        )
        self._targets(root)
        mrml.add(
            "IGTLConnector", "Sonospline", connectorType="CLIENT", serverHostname=host, serverPort=port, persistent=1,
            state=2, restrictDeviceName=0,
        )  # fmt: skip
        if drive is not None:
            self._drive(drive)
        if watch is not None:
            self._watch(watch, models, poses[names.NeedleTip])
        self._slice(image)
        mrml.add("Layout", "Layout", currentViewArrangement=FOUR_UP)
        return mrml

    def _transform(self, name: str, matrix: NDArray[np.floating], references: dict[str, str] | None = None) -> str:
        return self._mrml.add("LinearTransform", name, references=references, matrixTransformToParent=matrix)

    def _image(self, root: dict[str, str]) -> str:
        content = self._sent[self._names.Image]
        assert isinstance(content, igtl.Image)
        data = nrrd_bytes(content.voxels, content.ijk_to_reference)
        return self._mrml.shown(
            "Volume", self._names.Image, ("VolumeArchetypeStorage", f"{self._names.Image}.nrrd", data), root,
            colorNodeID=GREY, window=255, level=127.5, autoWindowLevel=0, interpolate=1,
        )  # fmt: skip

    def _models(self, root: dict[str, str]) -> dict[str, str]:
        """The surfaces by the names of their messages, which thus become these nodes."""
        taken: set[str] = set()
        found = {}
        for mesh in self._scene.meshes:
            if mesh.kind == "surface":
                name = device_name(mesh.name, taken)
                points = self._frames.points(mesh.points)
                found[name] = self._mrml.surface(name, points, mesh.indices, mesh.colour, mesh.opacity, root)
        return found

    def _targets(self, root: dict[str, str]) -> None:
        content = self._sent[self._names.Targets]
        assert isinstance(content, igtl.Points)
        self._mrml.fiducials(self._names.Targets, {one.name: one.position for one in content.entries}, root)

    def _drive(self, port: int) -> None:
        """Three transforms that go out: the tools are where they are now until somebody moves them."""
        tracker, outgoing = "Tracker", []
        frames, names = self._frames, self._names
        for frame, name in ((frames.probe, names.Probe), (frames.needle, names.Needle), (frames.reference, "")):
            content = self._sent.get(name)
            matrix = content.matrix if isinstance(content, igtl.Transform) else np.eye(4)
            if len(sent := f"{frame}To{tracker}") > LONGEST_NAME:
                raise ValueError(f"drive: no message can carry {sent}; give {frame} a name of fewer letters")
            pushed = {"OpenIGTLinkIF.pushOnConnect": "true"}
            outgoing.append(self._mrml.add("LinearTransform", sent, attributes=pushed, matrixTransformToParent=matrix))
        self._mrml.add(
            "IGTLConnector", "Tracker", references={"outgoing": " ".join(outgoing)}, connectorType="SERVER",
            serverPort=port, persistent=1, state=2, restrictDeviceName=0,
        )  # fmt: skip

    def _watch(self, name: str, models: dict[str, str], tip: str) -> None:
        if name not in models:
            raise ValueError(f"watch = {name!r} is no model of this scene; choose one of {', '.join(models)}")
        references = {"watchedModelNode": models[name], "toolTransformNode": tip}
        self._mrml.add("BreachWarning", "BreachWarning", references=references, playWarningSound=False)

    def _slice(self, image: str) -> None:
        driver = {
            "VolumeResliceDriver.Driver": image, "VolumeResliceDriver.Mode": _TRANSVERSE,
            "VolumeResliceDriver.Flip": "1",
        }  # fmt: skip
        self._mrml.slice_view("Red", self._slice_to_world(), image, attributes=driver, sliceVisibility=True)

    def _slice_to_world(self) -> Array:
        """The image's plane, its top up: where the driver puts it with the first image."""
        content = self._sent[self._names.Image]
        assert isinstance(content, igtl.Image)
        place = self._frames.reference_to_world @ content.ijk_to_reference
        x, y, _ = place[:3, :3].T
        found = np.eye(4)
        found[:3, 0], found[:3, 1] = x / np.linalg.norm(x), -y / np.linalg.norm(y)
        found[:3, 2] = np.cross(found[:3, 0], found[:3, 1])
        found[:3, 3] = (self._frames.reference_to_world @ [*content.centre, 1])[:3]
        return found


def _box(width_mm: float) -> tuple[Array, NDArray[np.integer]]:
    """A probe: its face is at y = 0 about the origin, its body behind it."""
    corners = np.indices((2, 2, 2)).reshape(3, -1).T - (0.5, 1.0, 0.5)
    quads: NDArray[np.int64] = np.array(
        [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    )
    box = (corners * (width_mm, 60.0, 12.0)).astype(np.float64)
    return box, np.vstack([quads[:, :3], quads[:, [0, 2, 3]]])

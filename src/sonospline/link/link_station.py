"""A simulator on OpenIGTLink: what a session shows goes out, and what comes in is heeded."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .. import igtl
from .._seldom import Seldom
from ..io.pose_sequence import PoseSequence
from ..simulator.command import ImageSettings
from ..simulator.scene import Scene
from ..simulator.simulated_frame import SimulatedFrame
from ..tracking.recorded_hand import RecordedHand
from .coordinate_frames import CoordinateFrames
from .frame_messages import OK, messages_of
from .link_connection import Connection
from .link_recording import LinkRecording
from .link_server import LinkServer
from .mesh_messages import MeshMessages
from .plus_commands import CommandDesk
from .scanner_commands import scanner_actions
from .scanner_names import ScannerNames
from .scene_receiver import SceneReceiver
from .tool_tracking import ToolTracking
from .tracker import Tracker

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

_NUMBERED = re.compile(r"[-_ ]?\d+\Z")
"""What 3D Slicer puts behind the names of fiducials."""
POSES = ("TRANSFORM", "POSITION", "QTRANS", "TDATA", "QTDATA")
READS = (*POSES, "POINT", "IMAGE", "LBMETA", "STRING", "COMMAND")


class Driven(Protocol):
    """A session as what comes in from a link sees it."""

    @property
    def scene(self) -> Scene | None:
        """What is simulated now; None while nothing is."""
        ...

    @property
    def settings(self) -> ImageSettings:
        """Of the image, as they are asked for."""
        ...

    def change(self, settings: ImageSettings) -> None:
        """Ask for other settings of the image; ValueError where the scene does not have them."""
        ...

    def aim(self, *, target: Array | None = None, entry: Array | None = None) -> None:
        """Put the target somewhere, in undeformed tissue, or have the needle wait at a point of the skin."""
        ...

    def load(self, scene: Scene) -> None:
        """Go on in another scene; ValueError where that is not for a client to say."""
        ...

    def greet(self) -> None:
        """Make a frame soon: a client has come."""
        ...

    def follow(self, tracking: ToolTracking) -> None:
        """Look where needle and probe are now."""
        ...


class LinkStation:
    """A :class:`LinkServer` with everything that a scanner and tracker says and hears.

    Parameters
    ----------
    driven : Driven
        Whose frames are shown, and who follows what comes in.
    names : ScannerNames
    port, host
        As of :class:`LinkServer`.
    recordings : Path, optional
        A folder for what clients have recorded.
    """

    def __init__(
        self, driven: Driven, names: ScannerNames, *, port: int, host: str, recordings: Path | None = None
    ) -> None:
        self.driven, self.names, self.frames = driven, names, CoordinateFrames(names)
        self.tracking = ToolTracking(
            self.frames,
            latency_s={device.Id: device.LatencySec for device in names.Devices if device.LatencySec},
        )
        for device in names.Devices:
            self.tracking.reserve(device.transforms, device.Id)
        self.transforms: Mapping[str, Array] = {}
        """The poses sent last, by name."""
        self._meshes: tuple[Scene, MeshMessages] | None = None
        self._seldom = Seldom(logger)
        self.recording = LinkRecording(recordings, names.ImageOrientation)
        self._desk = CommandDesk(scanner_actions(self))
        self._scenes = SceneReceiver(self.frames, driven.load, self.warn)
        self.server = LinkServer(port, host=host, receive=self._receive, reads=READS, greet=driven.greet)
        self._sources: list[Tracker | RecordedHand] = [Tracker(device, self.take) for device in names.Devices]

    def show(self, frame: SimulatedFrame, scene: Scene, tip_to_world: Array) -> None:
        """Send a frame to all who are connected."""
        stamp = igtl.now()
        messages = messages_of(
            frame, tip_to_world, self.frames, moving=self.tracking.moving, missing=self.tracking.missing, stamp=stamp
        )
        self.transforms = {
            one.device: one.content.matrix.astype(float) for one in messages if isinstance(one.content, igtl.Transform)
        }
        try:
            self.recording.add(messages)
        except (ValueError, OSError) as error:
            self.warn(f"a frame is not recorded: {error}")
        self.server.publish(*messages, *self._meshes_of(scene).of(frame.field, stamp))

    def warn(self, line: str) -> None:
        """Say in the log what was refused, once a minute."""
        self._seldom.say(f"refused: {line}")

    def move(self, name: str, matrix: Array, source: str = "UpdateTransform") -> None:
        """Take a pose or a definition by its name; ValueError where it is about nothing here, or somebody else's."""
        if self.tracking.wants(name):
            self.tracking.take(name, matrix, source=source)
        else:
            self.tracking.define(name, matrix)
        self.driven.follow(self.tracking)

    def play(self, sequence: PoseSequence, name: str) -> None:
        """Have needle and probe follow a recording, over and over.

        Raises
        ------
        ValueError
            It holds nothing that moves them, or what another source gives.
        """
        if not any(self.tracking.wants(each) for each in sequence.poses):
            known = ", ".join(sequence.poses)
            raise ValueError(f"{name} holds {known}; give a recording of {self.names.Probe} or {self.names.Needle}")
        self.tracking.reserve(sequence.poses, name)

        def follow(each: str, pose: Array, seen: bool) -> None:
            try:
                self._follow(each, pose, name, None, seen)
            except ValueError as error:
                self.warn(f"{name}: {error}")

        self._sources.append(RecordedHand(sequence, follow))

    def close(self) -> None:
        """Hang up on all clients and trackers."""
        for source in self._sources:
            source.close()
        self.server.close()
        self.recording.close()

    def _meshes_of(self, scene: Scene) -> MeshMessages:
        if self._meshes is None or self._meshes[0] is not scene:
            if self._meshes is not None:
                self.server.publish(*self._meshes[1].gone())
            self._meshes = (scene, MeshMessages(scene, self.frames))
        return self._meshes[1]

    def _receive(self, message: igtl.Message, client: Connection) -> list[igtl.Message]:
        reply = self._desk.answer(message, client)
        if reply is None:
            self.take(message, client.info.address)
        return reply or []

    def take(self, message: igtl.Message, source: str) -> None:
        """Heed what a client or a tracker says."""
        try:
            match message.content:
                case igtl.Points() as points if message.device != self.names.Targets:
                    self._aim(points, message.device)
                case igtl.Image() | igtl.LabelList():
                    self._scenes.take(message)
                case igtl.TrackingData() | igtl.QuaternionTrackingData() as several:
                    for tool in several.tools:
                        self._track(tool.name, tool.matrix, message, source)
                case igtl.Transform() | igtl.Position() | igtl.QuaternionTransform() as pose:
                    self._track(message.device, pose.matrix, message, source)
        except ValueError as error:
            self.warn(f"{message.device}: {error}")

    def _track(self, name: str, matrix: NDArray[np.floating], message: igtl.Message, source: str) -> None:
        self._follow(name, matrix, source, igtl.seconds_of(message.stamp), is_seen(message.metadata))

    def _follow(self, name: str, matrix: NDArray[np.floating], source: str, stamp_s: float | None, seen: bool) -> None:
        if self.tracking.wants(name):
            self.tracking.take(name, matrix, source=source, stamp_s=stamp_s, seen=seen)
            self.driven.follow(self.tracking)

    def _aim(self, points: igtl.Points, device: str) -> None:
        roles = {self.names.TargetPoint.lower(): "target", self.names.EntryPoint.lower(): "entry"}
        back = self.frames.reference_to_world
        found = {}
        for point in points.entries:
            names = (_NUMBERED.sub("", text).lower() for text in (point.name, device))
            role = next((roles[name] for name in names if name in roles), None)
            if role is not None:
                found[role] = (back @ [*point.position, 1])[:3]
        if found:
            self.driven.aim(**found)


def is_seen(metadata: Mapping[str, str]) -> bool:
    """Whether the metadata of a pose say that a tracker saw its tool: PLUS's Status, or TransformStatus."""
    return all(value.upper() == OK for name, value in metadata.items() if name in ("Status", "TransformStatus"))

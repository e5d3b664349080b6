"""A simulator on OpenIGTLink: what a session shows goes out, and what comes in is heeded."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .. import igtl
from ..simulator.command import ImageSettings
from ..simulator.scene import Scene
from ..simulator.simulated_frame import SimulatedFrame
from .coordinate_frames import CoordinateFrames
from .frame_messages import OK, messages_of
from .link_connection import Connection
from .link_server import LinkServer
from .mesh_messages import MeshMessages
from .needle_pose import pose_along
from .plus_commands import CommandDesk
from .scanner_commands import scanner_actions
from .scanner_names import ScannerNames
from .tool_tracking import ToolTracking

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

_LINES_APART_S = 60.0
READS = ("TRANSFORM", "TDATA", "STRING", "COMMAND")


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
    """

    def __init__(self, driven: Driven, names: ScannerNames, *, port: int, host: str) -> None:
        self.driven, self.names, self.frames = driven, names, CoordinateFrames(names)
        self.tracking = ToolTracking(self.frames)
        self.transforms: Mapping[str, Array] = {}
        """The poses sent last, by name."""
        self._meshes: tuple[Scene, MeshMessages] | None = None
        self._lock, self._said = threading.Lock(), -_LINES_APART_S
        self._desk = CommandDesk(scanner_actions(self))
        self.server = LinkServer(port, host=host, receive=self._receive, reads=READS)

    def show(self, frame: SimulatedFrame, scene: Scene, tip_to_world: Array) -> None:
        """Send a frame to all who are connected."""
        stamp = igtl.now()
        messages = messages_of(
            frame, tip_to_world, self.frames, moving=self.tracking.moving, missing=self.tracking.missing, stamp=stamp
        )
        self.transforms = {
            one.device: one.content.matrix.astype(float) for one in messages if isinstance(one.content, igtl.Transform)
        }
        self.server.publish(*messages, *self._meshes_of(scene).of(frame.field, stamp))

    def warn(self, line: str) -> None:
        """Say in the log what was refused, once a minute."""
        now = time.monotonic()
        with self._lock:
            if now - self._said < _LINES_APART_S:
                return
            self._said = now
        logger.warning("refused: %s", line)

    def move(self, name: str, matrix: Array, source: str = "UpdateTransform") -> None:
        """Take a transform by its name; ValueError where it is about nothing here, or somebody else's."""
        if not self.tracking.wants(name):
            raise ValueError(f"{name!r} moves nothing here; give {self.names.Probe} or {self.names.Needle}")
        self.tracking.take(name, matrix, source=source)
        self.driven.follow(self.tracking)

    def close(self) -> None:
        """Hang up on all clients."""
        self.server.close()

    def _meshes_of(self, scene: Scene) -> MeshMessages:
        if self._meshes is None or self._meshes[0] is not scene:
            self._meshes = (scene, MeshMessages(scene, self.frames))
        return self._meshes[1]

    def _receive(self, message: igtl.Message, client: Connection) -> list[igtl.Message]:
        reply = self._desk.answer(message, client)
        if reply is None:
            self.take(message, client.info.address)
        return reply or []

    def take(self, message: igtl.Message, source: str) -> None:
        """Heed what a client or a tracker says."""
        content = message.content
        if isinstance(content, igtl.Transform):
            self._track({message.device: content}, message, source)
        elif isinstance(content, igtl.TrackingData):
            self._track({tool.name: igtl.Transform(tool.matrix) for tool in content.tools}, message, source)

    def _track(self, poses: Mapping[str, igtl.Transform], message: igtl.Message, source: str) -> None:
        seen = is_seen(message.metadata)
        for name, pose in poses.items():
            if not self.tracking.wants(name):
                continue
            try:
                matrix = pose.rigid if seen else np.eye(4)
                self.tracking.take(name, matrix, source=source, stamp_s=igtl.seconds_of(message.stamp), seen=seen)
            except ValueError as error:
                self.warn(f"{name}: {error}")
            else:
                self.driven.follow(self.tracking)


def is_seen(metadata: Mapping[str, str]) -> bool:
    """Whether the metadata of a pose say that a tracker saw its tool: PLUS's Status, or TransformStatus."""
    return all(value.upper() == OK for name, value in metadata.items() if name in ("Status", "TransformStatus"))


def waiting_pose(scene: Scene) -> Array:
    """Return the pose of a needle that nobody has moved: it waits at the skin."""
    start, skin = scene.start.needle, scene.frame
    return pose_along(skin.entry(start), skin.direction(start))

"""A simulated scanner and tracker on OpenIGTLink: poses come in, images, poses, forces and events go out."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import igtl
from ..geometry.needle import Needle
from ..simulator.command import ImageSettings
from ..simulator.session import Session
from ..simulator.simulated_frame import SimulatedFrame
from ..simulator.skin_frame import SkinFrame
from .link_connection import Connection
from .link_server import PORT, LinkServer
from .plus_commands import CommandDesk
from .scanner_commands import scanner_actions
from .scanner_names import ScannerNames

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

SLICE_MM = 1.0
"""Size of a voxel across the image (assumed): a picture has none."""
_OWNED_S = 2.0
"""How long a tool stays with the client that moved it last."""
_LINES_APART_S = 60.0
_LONGEST_DT_S = 0.1
_LEAST_SLOPE = 0.05
"""Cosine between needle and skin's normal below which it does not enter (assumed)."""
_FINE = {"Status": "OK"}


class Wanted(NamedTuple):
    """What clients have asked for, since the beginning: poses of tools, and settings."""

    probe_to_reference: Array | None = None
    needle_to_reference: Array | None = None
    settings: ImageSettings | None = None


class Scanner:
    """A session behind a :class:`LinkServer`, without a page.

    TRANSFORMs of probe and needle that come in drive it: the probe's origin is in the middle of its face, the needle's
    at its tip, z along it. A needle in front of the skin is out. Of several clients the first has a tool until it is
    silent for 2 s. What cannot be done (a pose that is not rigid, a tip beyond the tissue) is said in the log, once a
    minute, and leaves everything as it is. While nobody is connected, time stands still.

    Parameters
    ----------
    session : Session
        The scanner's own from now on.
    port, host
        As of :class:`LinkServer`.
    names : ScannerNames, optional

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.link import Scanner
    >>> with Scanner(ss.Session("gel", model="kelvinlet"), port=0) as scanner:
    ...     scanner.server.clients
    ()
    """

    def __init__(
        self, session: Session, *, port: int = PORT, host: str = "127.0.0.1", names: ScannerNames | None = None
    ) -> None:
        self.session, self.names = session, ScannerNames() if names is None else names
        self._lock, self._ending = threading.Lock(), threading.Event()
        self._wanted, self._transforms = Wanted(), dict[str, Array]()
        self._owners: dict[str, tuple[Connection, float]] = {}
        self._said = -_LINES_APART_S
        self._desk = CommandDesk(scanner_actions(self))
        self.frames = 0
        """How many were made."""
        self.server = LinkServer(port, host=host, receive=self._receive, reads=("TRANSFORM", "STRING", "COMMAND"))
        self._thread = threading.Thread(target=self._run, name="scanner", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it, and hang up on its clients."""
        self._ending.set()
        self._thread.join()
        self.server.close()

    def __enter__(self) -> Scanner:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Scanner({self.session!r}, {self.server!r})"

    def want(self, **changed: Any) -> None:
        """Ask for a pose or settings, from any thread."""
        with self._lock:
            self._wanted = self._wanted._replace(**changed)

    @property
    def wanted(self) -> Wanted:
        """What is asked for."""
        return self._wanted

    @property
    def transforms(self) -> Mapping[str, Array]:
        """The poses sent last, by name."""
        return self._transforms

    def move(self, name: str, matrix: Array) -> None:
        """Ask for the pose of a tool, by its device name; ValueError where it has no such tool."""
        tools = {self.names.Probe: "probe_to_reference", self.names.Needle: "needle_to_reference"}
        if name not in tools:
            raise ValueError(f"{name!r} moves nothing here; give {' or '.join(tools)}")
        self.want(**{tools[name]: matrix})

    def _receive(self, message: igtl.Message, client: Connection) -> list[igtl.Message]:
        reply = self._desk.answer(message, client)
        if reply is not None:
            return reply
        content = message.content
        if isinstance(content, igtl.Transform) and message.device in (self.names.Probe, self.names.Needle):
            try:
                self._own(message.device, client)
                self.move(message.device, content.rigid)
            except ValueError as error:
                self._warn(f"{message.device}: {error}")
        return []

    def _own(self, name: str, client: Connection) -> None:
        owner, since = self._owners.get(name, (client, 0.0))
        now = time.monotonic()
        if owner is not client and now - since < _OWNED_S:
            raise ValueError(f"{client.info.address} comes second, it is in the hand of {owner.info.address}")
        self._owners[name] = (client, now)

    def _warn(self, line: str) -> None:
        now = time.monotonic()
        if now - self._said >= _LINES_APART_S:
            logger.warning("refused: %s", line)
            self._said = now

    def _run(self) -> None:
        period, before = 1 / self.names.AcquisitionRate, time.monotonic()
        due, pose = before, np.eye(4)
        while not self._ending.wait(max(0.0, due - time.monotonic())):
            now = time.monotonic()
            due = max(due + period, now)
            wanted, dt, before = self._wanted, min(now - before, _LONGEST_DT_S), now
            if not self.server.clients:
                continue  # nobody looks
            pose = pose if wanted.needle_to_reference is None else wanted.needle_to_reference
            try:
                frame = self._step(wanted, dt)
            except Exception as error:  # whatever a model raises, the last frame stays
                self._warn(str(error) or type(error).__name__)
                continue
            self.frames += 1
            messages = messages_of(frame, pose, self.names)
            self._transforms = {
                one.device: one.content.matrix.astype(float)
                for one in messages
                if isinstance(one.content, igtl.Transform)
            }
            self.server.publish(*messages)

    def _step(self, wanted: Wanted, dt: float) -> SimulatedFrame:
        needles = None
        if wanted.needle_to_reference is not None:
            needle = needle_at(wanted.needle_to_reference, self.session.scene.frame)
            needles = {} if needle is None else {"needle": needle}
        return self.session.step(
            needles=needles, probe_to_reference=wanted.probe_to_reference, settings=wanted.settings, dt=dt
        )


def needle_at(needle_to_reference: Array, skin: SkinFrame) -> Needle | None:
    """Return the needle whose tip is at a pose's origin, along its z; None where the tip is in front of the skin.

    Raises
    ------
    ValueError
        It runs along the skin, or comes from within.
    """
    tip, along = needle_to_reference[:3, 3], needle_to_reference[:3, 2]
    deep = float((tip - skin.origin) @ skin.depth)
    if deep <= 0:
        return None
    slope = float(along @ skin.depth)
    if slope < _LEAST_SLOPE:
        raise ValueError(f"the needle's z and the way into the tissue have the cosine {slope:.2g}; turn it inwards")
    return Needle(tip - along * (deep / slope), tip)


def messages_of(frame: SimulatedFrame, needle_to_reference: Array, names: ScannerNames) -> list[igtl.Message]:
    """Return what is sent of a frame: image, poses, force, events and read-outs, all with the same stamp."""
    stamp, plane = igtl.now(), frame.image.plane
    voxels = plane.image_to_reference @ np.diag([*plane.spacing_mm, SLICE_MM, 1.0])
    tip, target = needle_to_reference.copy(), np.eye(4)
    if frame.needle is not None:
        tip[:3, 3] = frame.needle.tip
    target[:3, 3] = frame.target_now
    poses = {
        names.Probe: frame.probe_to_reference, names.Needle: needle_to_reference, names.NeedleTip: tip,
        names.Target: target,
    }  # fmt: skip
    messages = [igtl.Message(igtl.Image.of(frame.image.pixels[None], voxels), names.Image, stamp, _FINE)]
    messages += [
        igtl.Message(igtl.Transform(pose.astype(np.float32)), name, stamp, _FINE) for name, pose in poses.items()
    ]
    for force in list(frame.forces.values())[:1]:
        messages.append(igtl.Message(igtl.Sensor(force.force_n, igtl.unit("newton")), names.Force, stamp))
    messages += [igtl.Message(igtl.String(str(event)), names.Events, stamp) for event in frame.events]
    return [*messages, igtl.Message(igtl.String(_readouts(frame)), names.Readouts, stamp)]


def _readouts(frame: SimulatedFrame) -> str:
    values = {
        "frame": frame.number, "model": frame.model, "depth_mm": frame.readouts.depth,
        "tip_to_target_mm": frame.readouts.tip_to_target, "target_moved_mm": frame.readouts.moved,
        "axial_force_n": next((force.axial_n for force in frame.forces.values()), None),
    }  # fmt: skip
    return json.dumps({name: None if value != value else value for name, value in values.items()})

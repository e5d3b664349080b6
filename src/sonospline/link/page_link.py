"""A page's session on OpenIGTLink: clients see the frames that the page sees, and may move its needle and probe."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..geometry.pose import pose_along
from ..simulator.command import ImageSettings
from ..simulator.console import Console
from ..simulator.console_frame import ConsoleFrame
from ..simulator.runner import Runner
from ..simulator.scene import Scene
from ..simulator.skin_frame import SkinFrame
from ..simulator.stamp import Stamp
from ..simulator.subscription import Subscription
from .link_server import PORT, LinkServer
from .link_station import LinkStation
from .needle_pose import needle_at, pose_towards
from .scanner_names import ScannerNames
from .tool_tracking import ToolTracking

Array = NDArray[np.float64]


class PageLink:
    """A :class:`LinkServer` beside a page.

    The session that was there first is shown until it ends, then another. Poses that come in become commands of the
    page's session: its probe stands on the skin as the scene presses it, so that the nearest such pose is taken.

    Parameters
    ----------
    port, host
        As of :class:`LinkServer`.
    names : ScannerNames, optional

    Examples
    --------
    >>> from sonospline.link import PageLink
    >>> with PageLink(port=0) as link:
    ...     link.server.clients
    ()
    """

    def __init__(self, *, port: int = PORT, host: str = "127.0.0.1", names: ScannerNames | None = None) -> None:
        self._lock = threading.Lock()
        self._shown: Runner[Any] | None = None
        self._last: tuple[ConsoleFrame, Stamp] | None = None
        self._watched: list[Subscription] = []
        self._due = 0.0
        self.station = LinkStation(self, ScannerNames() if names is None else names, port=port, host=host)

    @property
    def server(self) -> LinkServer:
        """Who is connected."""
        return self.station.server

    def watch(self, runner: Runner[Any]) -> Subscription:
        """Show a session's frames from now on, when it is its turn, until it ends."""
        subscription = runner.subscribe(
            lambda frame, stamp: self._take(runner, frame, stamp), ready=lambda: bool(self.server.clients)
        )
        with self._lock:
            self._watched = [one for one in (*self._watched, subscription) if not one.closed]
        return subscription

    def close(self) -> None:
        """Hang up on all clients."""
        self.station.close()

    def __enter__(self) -> PageLink:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"PageLink({self.server!r})"

    @property
    def scene(self) -> Scene | None:
        """Of the session that is shown."""
        shown = self._shown
        return None if shown is None else shown.console.scene

    @property
    def settings(self) -> ImageSettings:
        """Of the image, in the frame shown last."""
        return self._newest()[0].command.image

    def change(self, settings: ImageSettings) -> None:
        """Ask for other settings of the image; FieldError for those beyond the scene's."""
        self._command(image=settings)

    def aim(self, *, target: Array | None = None, entry: Array | None = None) -> None:
        """Put the page's target somewhere, or have its needle wait at a point of the skin."""
        shown = self._shown
        if shown is not None:
            shown.do(lambda console: _aim(console, target))
            if entry is not None:
                self._wait_at(entry, self._newest()[0].target_rest if target is None else target)

    def load(self, scene: Scene) -> None:
        """Refuse: which scene is shown is for the page to say."""
        raise ValueError("a page chooses its own scene; run sonospline link without one to send scenes")

    def greet(self) -> None:
        """Have sessions that wait for a client go on."""
        for subscription in self._watched:
            subscription.wake()

    def follow(self, tracking: ToolTracking) -> None:
        """Have the session's needle and probe follow what trackers say."""
        scene, tip, face = self.scene, tracking.tip(), tracking.face()
        if scene is None:
            return
        changed: dict[str, object] = {}
        if tip is not None:
            needle = needle_at(tip, scene.frame)
            before = self._newest()[0].command.needle
            changed["needle"] = replace(before, depth=0.0) if needle is None else scene.frame.needle_command(needle)
        if face is not None:
            press = scene.spec.probe.press_mm
            changed["probe"] = scene.frame.probe_command(_standing(face, scene.frame, press), press)
        self._command(**changed)

    def _command(self, **changed: object) -> None:
        shown = self._shown
        if shown is None:
            raise ValueError("no page is open; open one, and it can be moved")
        shown.amend(lambda command: replace(command, **changed))

    def _wait_at(self, entry: Array, target: Array) -> None:
        scene = self.scene
        if scene is not None:
            place = pose_towards(entry, target, scene)
            needle = scene.frame.needle_command(Needle(place[:3, 3], place[:3, 3] + place[:3, 2]))
            self._command(needle=replace(needle, depth=0.0))

    def _newest(self) -> tuple[ConsoleFrame, Stamp]:
        if self._last is None:
            raise ValueError("no page is open; open one, and it can be moved")
        return self._last

    def _take(self, runner: Runner[Any], frame: ConsoleFrame, stamp: Stamp) -> None:
        """Show a frame, no more often than asked for: one that comes meanwhile waits, and the newest wins."""
        with self._lock:
            if self._shown is None or not self._shown.alive:
                self._shown = runner
            if self._shown is not runner:
                return
            self._last = (frame, stamp)
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + 1 / self.station.names.AcquisitionRate
        tip = self.station.tracking.tip()
        self.station.show(frame, runner.console.scene, pose_along(frame.tip, frame.direction) if tip is None else tip)


def _aim(console: Console, target: Array | None) -> None:
    if target is not None:
        console.session.choose_target(console.session.target, target)


def _standing(face_to_world: Array, skin: SkinFrame, press_mm: float) -> Array:
    """The nearest pose of a probe that stands on the skin, pressed in so far: neither rocked nor lifted."""
    place = np.eye(4)
    x = face_to_world[:3, 0] - (face_to_world[:3, 0] @ skin.depth) * skin.depth
    x /= max(float(np.linalg.norm(x)), 1e-9)
    y = face_to_world[:3, 1] - (face_to_world[:3, 1] @ x) * x
    y /= max(float(np.linalg.norm(y)), 1e-9)
    origin = face_to_world[:3, 3]
    lifted = (origin - skin.origin) @ skin.depth - press_mm
    place[:3] = np.column_stack([x, y, np.cross(x, y), origin - lifted * skin.depth])
    return place

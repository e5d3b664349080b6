"""A simulated scanner and tracker on OpenIGTLink: poses come in, images, poses, forces and events go out."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..simulator.command import ImageSettings
from ..simulator.scene import Scene
from ..simulator.session import Session
from ..simulator.simulated_frame import SimulatedFrame
from .link_server import PORT, LinkServer
from .link_station import LinkStation
from .needle_pose import needle_at, pose_towards, waiting_pose
from .scanner_names import ScannerNames
from .tool_tracking import ToolTracking

Array = NDArray[np.float64]

_LONGEST_DT_S = 0.1


class Wanted(NamedTuple):
    """What is asked for, since the beginning: poses of the probe's face and of the needle's tip, and settings."""

    probe_to_reference: Array | None = None
    tip_to_reference: Array | None = None
    settings: ImageSettings | None = None


class Scanner:
    """A session behind a :class:`LinkServer`, without a page.

    Transforms of probe and needle that come in drive it, in any of the coordinate systems that its names define; by
    default the probe's origin is in the middle of its face, the needle's at its tip, z along it. A needle in front of
    the skin is out. Of several clients the first has a transform until it is silent for 2 s. What cannot be done (a
    pose that is not rigid, a tip beyond the tissue) is said in the log, once a minute, and leaves everything as it is.
    While nobody is connected, time stands still.

    Parameters
    ----------
    session : Session
        The scanner's own from now on.
    port, host
        As of :class:`LinkServer`.
    names : ScannerNames, optional
    recordings : Path, optional
        A folder for what clients have recorded (StartRecording); without it they are refused.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.link import Scanner
    >>> with Scanner(ss.Session("gel", model="kelvinlet"), port=0) as scanner:
    ...     scanner.server.clients
    ()
    """

    def __init__(
        self,
        session: Session,
        *,
        port: int = PORT,
        host: str = "127.0.0.1",
        names: ScannerNames | None = None,
        recordings: Path | None = None,
    ) -> None:
        self.session = session
        self._lock, self._ending, self._came = threading.Lock(), threading.Event(), threading.Event()
        self._wanted, self._waiting = Wanted(), waiting_pose(session.scene)
        self._actions: list[Callable[[], object]] = []
        self.frames = 0
        """How many were made."""
        self.station = LinkStation(
            self, ScannerNames() if names is None else names, port=port, host=host, recordings=recordings
        )
        self._thread = threading.Thread(target=self._run, name="scanner", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it, and hang up on its clients."""
        self._ending.set()
        self._came.set()
        self._thread.join()
        self.station.close()

    def __enter__(self) -> Scanner:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Scanner({self.session!r}, {self.server!r})"

    @property
    def names(self) -> ScannerNames:
        """What it calls what it sends."""
        return self.station.names

    @property
    def server(self) -> LinkServer:
        """Who is connected."""
        return self.station.server

    @property
    def scene(self) -> Scene:
        """What is simulated."""
        return self.session.scene

    @property
    def settings(self) -> ImageSettings:
        """Of the image, as they are asked for."""
        last = self.session.last
        return self._wanted.settings or (self.scene.start.image if last is None else last.settings)

    def change(self, settings: ImageSettings) -> None:
        """Ask for other settings of the image; FieldError for those beyond the scene's."""
        self.scene.check(replace(self.scene.start, image=settings))
        self.want(settings=settings)

    def aim(self, *, target: Array | None = None, entry: Array | None = None) -> None:
        """Put the target somewhere, or have the needle wait at a point of the skin, from the next step on."""
        self._do(lambda: self._aim(target, entry))

    def load(self, scene: Scene) -> None:
        """Go on in another scene, from the next step on, with its needle out."""
        self._do(lambda: self._load(scene))

    def greet(self) -> None:
        """Do nothing: frames are made as soon as anybody is there."""

    def follow(self, tracking: ToolTracking) -> None:
        """Have the next step begin early, where the last one is half a period old: a hand does not wait."""
        self._came.set()

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
        return self.station.transforms

    def _run(self) -> None:
        period, before = 1 / self.names.AcquisitionRate, time.monotonic()
        due = before
        while True:
            self._wait(due, period)
            if self._ending.is_set():
                return
            now = time.monotonic()
            due = max(due + period, now)
            dt, before = min(now - before, _LONGEST_DT_S), now
            self._act()
            if not self.server.clients:
                continue  # nobody looks
            try:
                wanted = self._newest()
                tip = self._waiting if wanted.tip_to_reference is None else wanted.tip_to_reference
                self.station.show(self._step(wanted, dt), self.scene, tip)
            except Exception as error:  # whatever a model or a client's transform raises, the next frame may do
                self.station.warn(str(error) or type(error).__name__)
            else:
                self.frames += 1

    def _do(self, action: Callable[[], object]) -> None:
        with self._lock:
            self._actions.append(action)

    def _act(self) -> None:
        with self._lock:
            actions, self._actions = self._actions, []
        for action in actions:
            try:
                action()
            except ValueError as error:
                self.station.warn(str(error))

    def _aim(self, target: Array | None, entry: Array | None) -> None:
        if target is not None:
            self.session.choose_target(self.session.target, target)
        if entry is not None:
            self._waiting = pose_towards(entry, self.session.targets[self.session.target], self.scene)

    def _load(self, scene: Scene) -> None:
        self.session = Session(scene, model=self.session.model)
        self._wanted, self._waiting = Wanted(), waiting_pose(scene)

    def _wait(self, due: float, period: float) -> None:
        """Wait until the next step is due, or half of that and a pose has come."""
        self._ending.wait(max(0.0, due - period / 2 - time.monotonic()))
        self._came.wait(max(0.0, due - time.monotonic()))
        self._came.clear()

    def _newest(self) -> Wanted:
        tracking = self.station.tracking
        found = {"tip_to_reference": tracking.tip(), "probe_to_reference": tracking.face()}
        self.want(**{name: pose for name, pose in found.items() if pose is not None})
        return self._wanted

    def _step(self, wanted: Wanted, dt: float) -> SimulatedFrame:
        needles: dict[str, Needle] | None = None
        if wanted.tip_to_reference is not None:
            needle = needle_at(wanted.tip_to_reference, self.scene.frame)
            needles = {} if needle is None else {"needle": needle}
        return self.session.step(
            needles=needles, probe_to_reference=wanted.probe_to_reference, settings=wanted.settings, dt=dt
        )

"""Where needle and probe are, by poses that come from trackers and clients in any of a file's coordinate systems."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry.pose import rigid
from ..tracking.clutch import Clutch
from ..tracking.pose_track import PoseTrack, StampClock
from ..tracking.transform_repository import TransformRepository, frames_of
from .coordinate_frames import IMAGE, TRANSDUCER, WORLD, CoordinateFrames

Array = NDArray[np.float64]

NEEDLE, PROBE = "needle", "probe"
OWNED_S = 2.0
"""How long a transform stays with the sender that gave it last."""
_MEASURED = 5e-3
"""How far the axes of a measured pose may be from upright: ten times the most in PLUS's recordings of trackers."""
_MOST_NAMES = 64
"""Of transforms, which clients choose; those of the tools themselves and of trackers that are set up come besides."""


class ToolTracking:
    """Takes transforms by name and answers where the needle's tip and the probe's face are; from any thread.

    Parameters
    ----------
    frames : CoordinateFrames
    latency_s : mapping of str to float, optional
        How long before its arrival a pose of a source was true; poses are guessed ahead by it.
    clock : callable, optional
        Seconds.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.link import ScannerNames
    >>> from sonospline.link.coordinate_frames import CoordinateFrames
    >>> from sonospline.link.tool_tracking import ToolTracking
    >>> tracking = ToolTracking(CoordinateFrames(ScannerNames()))
    >>> tracking.take("NeedleToTracker", np.diag([1.0, -1, -1, 1]), source="aurora")
    >>> tracking.tip() is None  # where the reference is in the tracker is not known yet
    True
    >>> tracking.take("ReferenceToTracker", np.eye(4), source="aurora")
    >>> tracking.tip().diagonal().tolist()
    [1.0, -1.0, -1.0, 1.0]
    """

    def __init__(
        self,
        frames: CoordinateFrames,
        *,
        latency_s: dict[str, float] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._frames, self._latency, self._clock = frames, latency_s or {}, clock
        self._fixed: dict[str, str] = {}
        self._lock = threading.RLock()
        self._known = frames.known.copy()
        self._tracks: dict[str, PoseTrack] = {}
        self._clocks: dict[str, StampClock] = {}
        self._owners: dict[str, tuple[str, float]] = {}
        self._unseen: set[str] = set()
        self._clutches = {NEEDLE: Clutch(), PROBE: Clutch()}
        self._ways = {NEEDLE: (frames.tip, WORLD), PROBE: (TRANSDUCER, WORLD)}
        self._devices = {NEEDLE: (frames.names.Needle, frames.names.NeedleTip), PROBE: (frames.names.Probe,)}

    def reserve(self, names: Iterable[str], source: str) -> None:
        """Take transforms from one source alone from now on; ValueError where another has one of them already."""
        wanted = {name: source for name in names if self.wants(name)}
        for name in wanted:
            if self._fixed.get(name, source) != source:
                raise ValueError(f"{source} and {self._fixed[name]} both give {name}; leave one of them out")
        self._fixed |= wanted

    def wants(self, name: str) -> bool:
        """Return whether a transform is about any of the coordinate systems that are known here, and no definition."""
        try:
            source, target = frames_of(name)
        except ValueError:
            return False
        if IMAGE in (source, target):  # the simulator's own: it follows from the probe
            return False
        frames = self._frames
        tools = {frames.needle, frames.probe, frames.tip, TRANSDUCER, frames.reference}
        return name in self._fixed or ((source in tools or source in frames.known.frames) and name not in frames.known)

    def take(
        self, name: str, matrix: ArrayLike, *, source: str, stamp_s: float | None = None, seen: bool = True
    ) -> None:
        """Take a transform.

        Parameters
        ----------
        name : str
            ``NeedleToTracker``, for example.
        matrix : (4, 4) array_like
            mm, rigid but for what trackers round: the nearest such pose is taken.
        source : str
            Who gives it; another who gave it within two seconds is asked first.
        stamp_s : float, optional
            By the sender's clock.
        seen : bool, default: True
            Whether the tracker sees the tool; where not, the matrix means nothing and the tool stays where it was.

        Raises
        ------
        ValueError
            Not rigid, somebody else's, in contradiction to what is known, or one more than are followed.
        """
        now = self._clock()
        pose = rigid(name, matrix, within=_MEASURED) if seen else None
        with self._lock:
            self._refuse_second(name, source, now)
            given_up = self._in_place_of(name, source, now)
            if pose is not None:
                self._known.set(name, pose)
            if given_up is not None:
                self._forget(given_up)
            self._own(name, source, now)
            if pose is None:
                self._unseen.add(name)
                return
            self._unseen.discard(name)
            measured = self._clocks.setdefault(source, StampClock()).measured(stamp_s, now)
            self._tracks.setdefault(name, PoseTrack()).add(pose, measured - self._latency.get(source, 0.0))

    def define(self, name: str, matrix: ArrayLike) -> None:
        """Give one of the frames' definitions anew; ValueError as of :meth:`CoordinateFrames.define`."""
        with self._lock:
            self._frames.define(name, matrix)
            self._known.set(name, self._frames.known.get(name))

    def tip(self) -> Array | None:
        """Return the pose of the needle's tip in the simulator's world; None where it is not known."""
        return self._tool(NEEDLE)

    def face(self) -> Array | None:
        """Return the pose of the middle of the probe's face."""
        return self._tool(PROBE)

    def clutch(self, tool: str, is_open: bool) -> None:
        """Open or close the clutch between a hand and ``needle`` or ``probe``."""
        if tool not in self._clutches:
            raise ValueError(f"tool = {tool!r} has no clutch; give {' or '.join(self._clutches)}")
        with self._lock:
            clutch = self._clutches[tool]
            self._tool(tool)  # where the hand is now
            clutch.open() if is_open else clutch.close()

    @property
    def missing(self) -> frozenset[str]:
        """Devices whose tool a tracker does not see now."""
        with self._lock:
            found = [
                device
                for tool, devices in self._devices.items()
                for device in devices
                if self._unseen & self._names_on(self._ways[tool])
            ]
        return frozenset(found)

    @property
    def moving(self) -> TransformRepository:
        """What is known: definitions, and the newest of what came."""
        with self._lock:
            return self._known.copy()

    def _refuse_second(self, name: str, source: str, now: float) -> None:
        fixed = self._fixed.get(name)
        if fixed not in (None, source):
            raise ValueError(f"{source} comes second, {fixed} is the source of {name}")
        owner, since = self._owners.get(name, (source, 0.0))
        if owner != source and now - since < OWNED_S:
            raise ValueError(f"{source} comes second, {name} is in the hand of {owner}")

    def _in_place_of(self, name: str, source: str, now: float) -> str | None:
        """The transform that a new one takes the place of: of whoever has most, the one not given for longest."""
        exempt = self._fixed.keys() | {each for devices in self._devices.values() for each in devices}
        chosen = {each: owned for each, owned in self._owners.items() if each not in exempt}
        if name in self._owners or name in exempt or len(chosen) < _MOST_NAMES:
            return None
        counts = Counter(owner for owner, _ in chosen.values())
        found = max(chosen, key=lambda each: (counts[chosen[each][0]], now - chosen[each][1]))
        owner, since = chosen[found]
        if counts[source] >= counts[owner] and now - since < OWNED_S:
            raise ValueError(f"{name} is one transform more than the {_MOST_NAMES} that are followed; give fewer")
        return found

    def _own(self, name: str, source: str, now: float) -> None:
        before, _ = self._owners.get(name, (source, now))
        self._owners[name] = (source, now)
        self._forget_clock(before)

    def _forget(self, name: str) -> None:
        owner, _ = self._owners.pop(name)
        self._known.forget(name)
        self._tracks.pop(name, None)
        self._unseen.discard(name)
        self._forget_clock(owner)

    def _forget_clock(self, source: str) -> None:
        """Forget the clock of who gives nothing any more."""
        if all(owner != source for owner, _ in self._owners.values()):
            self._clocks.pop(source, None)

    def _tool(self, tool: str) -> Array | None:
        source, target = self._ways[tool]
        with self._lock:
            if not self._is_tracked(tool):
                return None
            known = self._known if not self._latency else self._ahead(self._names_on(self._ways[tool]))
            return self._clutches[tool].tool(rigid(tool, known.get(f"{source}To{target}")))

    def _is_tracked(self, tool: str) -> bool:
        """Whether a way leads from the tool to the world over something that came: definitions alone say nothing."""
        return bool(self._names_on(self._ways[tool]) & self._tracks.keys())

    def _names_on(self, ends: tuple[str, str]) -> set[str]:
        way = self._known.way(*ends) or []
        steps = [*pairwise(way)]
        return {f"{a}To{b}" for a, b in steps} | {f"{b}To{a}" for a, b in steps}

    def _ahead(self, names: set[str]) -> TransformRepository:
        """What will be now, by the motion of what has come a while ago."""
        known, now = self._known.copy(), self._clock()
        for name in names & self._tracks.keys():
            source = self._owners[name][0]
            if self._latency.get(source, 0.0) > 0:
                known.set(name, self._tracks[name].at(now))
        return known

    def __repr__(self) -> str:
        return f"ToolTracking({', '.join(self._tracks) or 'nothing came'})"

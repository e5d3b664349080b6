"""A tracked recording as a source of poses: a sonographer's hand, replayed in the time it took."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..io.pose_sequence import PoseSequence

Receive = Callable[[str, NDArray[np.float64], bool], object]


class RecordedHand:
    """Plays the poses of a recording, in a thread of its own, over and over.

    Parameters
    ----------
    sequence : PoseSequence
    receive : callable
        Called as ``receive(name, pose, seen)`` with each pose, at its time.
    speed : float, default: 1
    repeat : bool, default: True

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.io.pose_sequence import PoseSequence
    >>> from sonospline.tracking import RecordedHand
    >>> hand = PoseSequence(np.array([0.0, 0.01]), {"ProbeToTracker": np.stack([np.eye(4)] * 2)},
    ...                     {"ProbeToTracker": np.array([True, False])})
    >>> came = []
    >>> with RecordedHand(hand, lambda name, pose, seen: came.append((name, seen)), repeat=False) as playing:
    ...     playing.wait(10)
    True
    >>> came
    [('ProbeToTracker', True), ('ProbeToTracker', False)]
    """

    def __init__(
        self,
        sequence: PoseSequence,
        receive: Receive,
        *,
        speed: float = 1.0,
        repeat: bool = True,
    ) -> None:
        self._sequence, self._receive, self._speed, self._repeat = sequence, receive, speed, repeat
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorded hand", daemon=True)
        self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Wait until it has played to its end; return whether it has."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def close(self) -> None:
        """Stop."""
        self._ending.set()
        self._thread.join()

    def __enter__(self) -> RecordedHand:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"RecordedHand({self._sequence!r})"

    def _run(self) -> None:
        times = (self._sequence.time_s - self._sequence.time_s[0]) / self._speed
        while not self._ending.is_set():
            began = time.monotonic()
            for frame, due in enumerate(times):
                if self._ending.wait(max(0.0, began + due - time.monotonic())):
                    return
                for name, poses in self._sequence.poses.items():
                    self._receive(name, poses[frame], bool(self._sequence.seen[name][frame]))
            if not self._repeat:
                return
            self._ending.wait(1 / 60)  # a recording of one frame

"""A trace that grows sample by sample, and can be measured at any time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .trace import Sample, Trace

_FIRST = 256
"""Samples that there is room for at first; the room doubles when it is full."""
_PARTS = {"time_s": (), "entry": (3,), "tip": (3,), "probe_to_reference": (4, 4), "target": (3,), "out_of_plane": (),
          "half_slice": (), "axial_n": ()}  # fmt: skip


class GrowingTrace:
    """Samples as they come; of several at one time the last counts.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.training import GrowingTrace
    >>> from sonospline.training.trace import Sample
    >>> session, growing = ss.Session("cube", model="kelvinlet"), GrowingTrace()
    >>> for depth in (10.0, 20.0, 30.0):
    ...     frame = session.step(needles={"needle": ss.Needle((50, 50, 0), (50, 50, depth))}, dt=0.1)
    ...     growing.add(frame.time_s, Sample.of(frame, session.scene))
    >>> len(growing), growing.trace()
    (3, Trace(3 samples, 0.2 s, 1 pass))
    """

    def __init__(self) -> None:
        self._room = {name: np.empty((_FIRST, *shape)) for name, shape in _PARTS.items()}
        self._structures: list[str] = []
        self._target_rest: NDArray[np.float64] | None = None
        self._target = ""

    def __len__(self) -> int:
        return len(self._structures)

    def add(self, time_s: float, sample: Sample) -> None:
        """Take a sample; one that is about another target, or earlier than the last, begins anew."""
        if len(self) and (sample.name != self._target or time_s < self._room["time_s"][len(self) - 1]):
            self.clear()
        if len(self) and time_s == self._room["time_s"][len(self) - 1]:
            self._structures.pop()
        at = len(self)
        if at == len(self._room["time_s"]):
            self._room = {name: np.concatenate([held, np.empty_like(held)]) for name, held in self._room.items()}
        values: dict[str, Any] = sample._asdict() | {"time_s": time_s}
        for name, held in self._room.items():
            held[at] = values[name]
        self._structures.append(sample.structure)
        self._target, self._target_rest = sample.name, sample.target_rest

    def clear(self) -> None:
        """Forget all samples."""
        self._structures.clear()

    def trace(self) -> Trace:
        """Return them as a trace.

        Raises
        ------
        ValueError
            There are fewer than two.
        """
        n = len(self)
        parts: dict[str, Any] = {name: held[:n] for name, held in self._room.items()}
        rest = np.full(3, np.nan) if self._target_rest is None else self._target_rest
        return Trace(**parts, target_rest=rest, structures=tuple(self._structures))

    def __repr__(self) -> str:
        return f"GrowingTrace({len(self)} samples)"

"""A clutch between a hand and a tool: while it is open, the hand moves and the tool does not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Clutch:
    """Joins a tool to a hand; after it was open, motion goes on from where the tool is, along the hand's own axes.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.tracking import Clutch
    >>> def at(x):
    ...     pose = np.eye(4)
    ...     pose[0, 3] = x
    ...     return pose
    >>> clutch = Clutch()
    >>> places = [clutch.tool(at(10))[0, 3]]
    >>> clutch.open()
    >>> places += [clutch.tool(at(30))[0, 3]]
    >>> clutch.close()
    >>> [float(x) for x in [*places, clutch.tool(at(31))[0, 3]]]
    [10.0, 10.0, 11.0]
    """

    def __init__(self) -> None:
        self._turn, self._shift = np.eye(3), np.zeros(3)
        self._hand: Array | None = None
        self._held: Array | None = None
        self.is_open = False

    def open(self) -> None:
        """Have the tool stay where it is."""
        self.is_open = True

    def close(self) -> None:
        """Have it follow the hand again, from here on."""
        if self.is_open and self._hand is not None and self._held is not None:
            self._turn = self._hand[:3, :3].T @ self._held[:3, :3]
            self._shift = self._held[:3, 3] - self._hand[:3, 3]
        self.is_open = False

    def __repr__(self) -> str:
        return f"Clutch({'open' if self.is_open else 'closed'})"

    def tool(self, hand: Array) -> Array:
        """Return the tool's pose for a hand's."""
        self._hand = hand
        if self.is_open and self._held is not None:
            return self._held
        tool = hand.copy()
        tool[:3, :3] = hand[:3, :3] @ self._turn
        tool[:3, 3] += self._shift
        self._held = tool
        return tool

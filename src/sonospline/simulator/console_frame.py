"""A frame as a console shows it: seen from the skin, with the pass it belongs to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .command import Command
from .logged_event import Log
from .pass_metrics import PassMetrics
from .readouts import Blocked
from .simulated_frame import SimulatedFrame

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ConsoleFrame(SimulatedFrame):
    """A frame with the command in force. Its read-outs are from the entry while the needle is out."""

    command: Command
    """The command in force: what was asked for, as far as the tissue allows it."""
    blocked: Blocked | None
    """Why the needle is not where it was asked to be, or goes no further."""
    bone: str | None
    """The bone that blocks it, as the label map calls it."""
    held_by: str | None
    """The tissue that holds it, as the label map calls it: it turns no further."""
    entry: Array
    """Where the needle meets the skin, or would."""
    tip: Array
    direction: Array
    metrics: PassMetrics
    """Of the present pass, or the last one."""
    log: Log
    """The last events in words, of frames that nobody saw, too."""

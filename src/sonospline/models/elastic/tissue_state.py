"""What an elastic model knows between two steps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...contact.track import Track
from ...elasticity.state import ElasticState, RelaxingState
from ...mechanics.shaft import Shaft
from ..contract import State

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False, repr=False)
class ElasticTissueState(State):
    """The needles, the displacement so far, and the tissue that its load acts on."""

    solution: ElasticState = field(kw_only=True)
    shafts: tuple[tuple[str, Shaft], ...] = field(default=(), kw_only=True)
    """Of each needle that loads tissue which has moved."""
    beside: float = field(default=0.0, kw_only=True)
    """Error of the displacement, relative, because loads act beside the tissue that their needles are in."""

    tracks: tuple[tuple[str, Track], ...] = field(default=(), kw_only=True)
    """Of each needle that remembers."""
    tissue: RelaxingState | None = field(default=None, kw_only=True)
    """What tissue remembers, with the same solution; where needles have tracks."""
    earlier: Single | None = field(default=None, kw_only=True)
    """(3, nx, ny, nz) displacement of the solver's nodes a step before; where needles have tracks."""
    looks: int = field(default=0, kw_only=True)
    """Times that the tissue which the needles load was looked for since they came to rest; of tracks one at most."""

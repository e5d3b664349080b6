"""A track at one moment, for whoever goes on without the tissue."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..mechanics.loads import MILLI
from .frozen_contact import FrozenContact
from .grip import stiffness_across
from .medium import Medium
from .motion import Motion
from .push import Push
from .track import Track

Single = NDArray[np.float32]


def frozen(medium: Medium, track: Track, needle: Needle, displacement: Single) -> FrozenContact:
    """Return a track as it is now, with a displacement (3, nx, ny, nz) of the nodes; the end of the cut last."""
    axis, end = needle.direction, track.end
    rows = np.vstack([np.eye(len(track)), end])
    push = Push(medium, "", Motion(needle, needle), displacement)
    bound, limit = push.bounds(track), push.limit(track)
    anchors = np.append(track.anchors + push.stretch(track), 0.0)  # of a shaft without bonds that is where this one is
    moved, behind = medium.moved(displacement, track.places) @ axis, (needle.tip - track.places) @ axis
    return FrozenContact(
        compliance_mm_n=MILLI * push.compliance(track, axis), places_mm=-(rows @ behind), displacement_mm=rows @ moved,
        forces_n=np.append(track.axial, track.tip) / MILLI, anchors_mm=anchors,
        low_n=np.append(-bound, 0.0) / MILLI, high_n=np.append(bound, limit) / MILLI, tip=len(track), axis=axis,
        tip_mm=needle.tip, lateral_n_mm=stiffness_across(track, axis) / MILLI,
        lateral_n=-track.lateral.sum(axis=0) / MILLI,
    )  # fmt: skip

"""A needle by knobs that meets bone: how deep it goes, and how far it turns."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from ..fields.field import Field
from ..mechanics.bone_stop import CLEARANCE_MM, bone_at
from .command import NeedleCommand
from .scene import Scene

_HALVINGS = 12
"""Of the step of a turn that meets bone: to a ten-thousandth of a voxel."""


def pushed(scene: Scene, needle: NeedleCommand, field: Field | None = None) -> tuple[NeedleCommand, str | None]:
    """Return a needle as deep as bone lets it in, and the bone it then rests on."""
    there = scene.frame.needle(needle)
    if scene.tissues is None or there is None:
        return needle, None
    met = bone_at(there, scene.tissues, field)
    if met is None:
        return needle, None
    return replace(needle, depth=min(needle.depth, max(0.0, met.depth_mm - CLEARANCE_MM))), met.name


def turned(
    scene: Scene, before: NeedleCommand, asked: NeedleCommand, field: Field | None = None
) -> tuple[NeedleCommand, str | None]:
    """Return a needle inside turned as far as its shaft and tip meet no bone, and the bone that they then meet.

    It turns where it is, or less deep if that is asked, and is pushed afterwards.
    """
    angles = np.array([[one.angle, one.swing] for one in (before, asked)])
    if scene.tissues is None or (angles[0] == angles[1]).all():
        return asked, None
    start, _ = pushed(scene, replace(before, depth=min(before.depth, asked.depth)), field)
    finest = min(scene.tissues.labels.spacing)
    steps = int(np.ceil(2 * start.depth * np.radians(np.abs(np.diff(angles, axis=0)).sum()) / finest)) or 1

    def bone(share: float) -> str | None:
        angle, swing = (angles[0] + share * (angles[1] - angles[0])).tolist()
        there = scene.frame.needle(replace(start, angle=angle, swing=swing))
        met = None if there is None or scene.tissues is None else scene.tissues.obstacle(there, field)
        return None if met is None else met.name

    for step in range(1, steps + 1):
        if found := bone(step / steps):
            free, met = (step - 1) / steps, step / steps
            for _ in range(_HALVINGS):
                middle = 0.5 * (free + met)
                found, free, met = (name, free, middle) if (name := bone(middle)) else (found, middle, met)
            angle, swing = (angles[0] + free * (angles[1] - angles[0])).tolist()
            return replace(asked, angle=angle, swing=swing), found
    return asked, None

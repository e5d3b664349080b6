"""A needle and the pose of its tip: origin at the tip, z along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..geometry.pose import pose_along
from ..simulator.scene import Scene
from ..simulator.skin_frame import SkinFrame

Array = NDArray[np.float64]

_LEAST_SLOPE = 0.05
"""Cosine between needle and skin's normal below which it does not enter (assumed)."""
_OFF_SKIN_MM = 10.0
"""How far a fiducial may be off the skin and still be on it."""


def needle_at(tip_to_world: Array, skin: SkinFrame) -> Needle | None:
    """Return the needle whose tip is at a pose's origin, along its z; None where the tip is in front of the skin.

    Raises
    ------
    ValueError
        It runs along the skin, or comes from within.
    """
    tip, along = tip_to_world[:3, 3], tip_to_world[:3, 2]
    deep = float((tip - skin.origin) @ skin.depth)
    if deep <= 0:
        return None
    slope = float(along @ skin.depth)
    if slope < _LEAST_SLOPE:
        raise ValueError(f"the needle's z and the way into the tissue have the cosine {slope:.2g}; turn it inwards")
    return Needle(tip - along * (deep / slope), tip)


def waiting_pose(scene: Scene) -> Array:
    """Return the pose of a needle that nobody has moved: it waits at the skin."""
    start, skin = scene.start.needle, scene.frame
    return pose_along(skin.entry(start), skin.direction(start))


def pose_towards(entry: Array, target: Array, scene: Scene) -> Array:
    """Return the pose of a needle that waits at a point of the skin, towards a target.

    Raises
    ------
    ValueError
        The point is more than 10 mm off the skin or beside it, or the way runs along it.
    """
    skin = scene.frame
    off = float((entry - skin.origin) @ skin.depth)
    if abs(off) > _OFF_SKIN_MM:
        raise ValueError(f"entry is {abs(off):.3g} mm off the skin; place it within {_OFF_SKIN_MM:g} mm of it")
    on_skin = entry - off * skin.depth
    scene.tissue.check_inside(entry=on_skin)
    along = target - on_skin
    if along @ skin.depth < _LEAST_SLOPE * np.linalg.norm(along):
        raise ValueError("entry leads along the skin to the target; place it above the target")
    return pose_along(on_skin, along)

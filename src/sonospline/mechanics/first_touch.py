"""First touch: what the tip of a needle does builds up from nothing as it enters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BUILD_UP_MM = 30.0
"""Of depth below the skin, until the whole cutting force acts; assumed. Tissue dents before it is pierced: over this
distance soft tissue of 5 kPa, whose surface a needle dents by 11 mm, follows the tip and never runs ahead of it. With
0.7 N at the tip and 0.03 N/mm along the shaft force rises by 0.53 N/cm; in fresh cadavers it does by 0.35 to 0.59
(J Endourol 2016, 10.1089/end.2016.0342). It begins as the square of the depth, like that on a cone (Sneddon 1965)."""

BEVEL_MM = 6.0
"""Of a tip, along the axis: that of an 18 gauge needle, 1.27 mm thick and ground to 12 degrees."""

_PARTS = 20
"""Of the bevel, each in the tissue at its end that is nearer to the entry."""


def built_up(depth: float, over: float) -> float:
    """Return how much of the tip acts at a depth: 0 at the skin, 1 from ``over`` on, t^2 (3 - 2 t) between.

    Its slope has no jump and is never above 1.5 / ``over``. Over no length the whole acts at once.

    Examples
    --------
    >>> from sonospline.mechanics import built_up
    >>> [round(built_up(depth, over=12), 3) for depth in (0.01, 1.2, 6, 12, 60)]
    [0.0, 0.028, 0.5, 1.0, 1.0]
    """
    return float(_share(np.array(depth), over)) if over > 0 else 1.0


def along_bevel(depth: float) -> tuple[Array, Array]:
    """Return places along the axis, and the share of each in what a tip meets; shares add up to one.

    A tip meets what its bevel is in, the middle of it most. Places do not move with the tip, only their
    shares change: where tissue does, the force passes from one value to the other without a jump.
    """
    part = BEVEL_MM / _PARTS
    places: Array = part * np.arange(max(0, int((depth - BEVEL_MM) / part)), int(np.ceil(depth / part)), dtype=float)
    passed = _share(depth - places, BEVEL_MM)
    shares = passed - np.append(passed[1:], 0.0)
    return places, shares / passed[0]


def _share(passed: Array, over: float) -> Array:
    t: Array = np.clip(passed, 0.0, over) / over
    return t * t * (3 - 2 * t)

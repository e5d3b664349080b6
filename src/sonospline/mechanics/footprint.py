"""What of a probe touches the skin: a rigid face, flat or convex, without friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._shown import figure

Array = NDArray[np.float64]

_MOST_ALONG = 64
"""Points along a side, at most."""


@dataclass(frozen=True)
class Footprint:
    """The rigid face of a probe: a rectangle, flat or bent about its width.

    Parameters
    ----------
    length_mm : float
        Along the image's x; of a bent face its chord.
    width_mm : float
        Across the image.
    radius_mm : float, default: 0
        Of a convex face; 0 where it is flat.

    Raises
    ------
    ValueError
        A length that is not above zero, or a chord longer than twice the radius.

    Examples
    --------
    >>> from sonospline.mechanics import Footprint
    >>> convex = Footprint(60.0, 20.0, radius_mm=60.0)
    >>> points = convex.points(6.0)
    >>> points.shape, float(points[:, 1].min().round(1))  # the ends are less deep than the middle
    ((30, 3), -6.4)
    """

    length_mm: float
    width_mm: float
    radius_mm: float = 0.0

    def __post_init__(self) -> None:
        for name, positive in (("length_mm", True), ("width_mm", True), ("radius_mm", False)):
            object.__setattr__(self, name, _validate.number(name, getattr(self, name), positive=positive))
        if 0 < self.radius_mm < self.length_mm / 2:
            raise ValueError(
                f"radius_mm = {figure(self.radius_mm)} is below half of length_mm = {figure(self.length_mm)}; give the "
                "radius of a convex face, or 0 for a flat one"
            )

    @property
    def area_mm2(self) -> float:
        """Length times width."""
        return self.length_mm * self.width_mm

    def points(self, spacing_mm: float) -> Array:
        """Return points (m, 3) of the face in the probe's axes, mm, in the middles of parts about as long as a spacing.

        x is to the right, y deep, z across the image; the middle of the face is at zero.
        """
        x, z = (_middles(side, spacing_mm) for side in (self.length_mm, self.width_mm))
        along, across = (values.ravel() for values in np.meshgrid(x, z, indexing="ij"))
        radius = self.radius_mm
        raised = radius - np.sqrt(radius**2 - along**2) if radius else np.zeros_like(along)
        return np.column_stack([along, -raised, across])

    def __repr__(self) -> str:
        bent = f", radius {self.radius_mm:g} mm" if self.radius_mm else ""
        return f"Footprint({self.length_mm:g} x {self.width_mm:g} mm{bent})"


def _middles(side: float, spacing: float) -> Array:
    parts = min(max(1, round(side / spacing)), _MOST_ALONG)
    return ((np.arange(parts) + 0.5) / parts - 0.5) * side

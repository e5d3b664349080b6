"""The picture of an insertion: a slice through the needle, before, after, and how far tissue moved."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..geometry.volume import Volume
from .canvas import picture

Array = NDArray[np.float64]

PIXELS = 400


class PicturePlane(NamedTuple):
    """The plane of the picture, which contains the needle: horizontal along it, vertical across it."""

    origin: Array
    along: Array
    across: Array
    left: float
    right: float
    bottom: float
    top: float

    @classmethod
    def through(cls, needle: Needle, volume: Volume) -> PicturePlane:
        """Return the plane through the needle that best follows an axis of the image."""
        axes = volume.lattice.direction.T
        along = needle.direction
        upright = axes[_least_aligned(axes, along, volume)]
        across = upright - (upright @ along) * along
        across /= np.linalg.norm(across)
        corners = volume.lattice.world(np.indices((2, 2, 2)).reshape(3, -1).T * volume.lattice.extent)
        a, b = (corners - needle.entry) @ along, (corners - needle.entry) @ across
        return cls(needle.entry, along, across, a.min(), a.max(), b.min(), b.max())

    def points(self) -> tuple[Array, tuple[int, int]]:
        """Return world points of the picture's pixels, top row first, and its (rows, columns)."""
        width, height = self.right - self.left, self.top - self.bottom
        step = max(width, height) / PIXELS
        a = np.arange(self.left, self.right + step / 2, step)
        b = np.arange(self.top, self.bottom - step / 2, -step)
        points = self.origin + a[None, :, None] * self.along + b[:, None, None] * self.across
        return points.reshape(-1, 3), (len(b), len(a))


def _least_aligned(axes: Array, along: Array, volume: Volume) -> int:
    """The longest image axis among those well off the needle's direction."""
    off = np.abs(axes @ along) < 0.8
    return int(np.argmax(np.where(off, volume.lattice.extent, -1.0)))


def draw_insertion(before: Volume, after: Volume, displacement: Volume, needle: Needle, path: Path) -> None:
    """Write the three-panel picture as a PNG.

    Parameters
    ----------
    before, after : Volume
        The image undeformed and deformed.
    displacement : Volume
        Magnitude of the displacement in mm, at deformed positions.
    needle : Needle
        The needle at its final depth.
    path : Path
        File to write.
    """
    plane = PicturePlane.through(needle, before)
    points, shape = plane.points()
    pictures = [v.sample(points).reshape(shape) for v in (before, after, displacement)]
    grey = tuple(np.nanpercentile(pictures[0], (1, 99.5)))
    aspect = shape[0] / shape[1]
    with picture(path, 15, 1.7 + 4.4 * aspect) as figure:
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        extent = (plane.left, plane.right, plane.bottom, plane.top)
        for panel, shades, title in zip(panels, pictures, ("before", "after", "displacement"), strict=True):
            style: dict[str, Any] = (
                {"cmap": "viridis", "vmin": 0}
                if title == "displacement"
                else {"cmap": "gray", "vmin": grey[0], "vmax": grey[1]}
            )
            shown = panel.imshow(shades, extent=extent, origin="upper", interpolation="bilinear", **style)
            panel.set_facecolor("0.15")
            panel.set_title(title)
            panel.set_xlabel("along the needle (mm)")
            _draw_needle(panel, needle, drawn=title != "before")
        panels[0].set_ylabel("across the needle (mm)")
        figure.colorbar(shown, ax=panels[2], label="displacement (mm)", shrink=0.9)


def _draw_needle(panel: Any, needle: Needle, *, drawn: bool) -> None:
    """Draw the shaft from its entry to its tip, or, before the insertion, the path to come."""
    style: dict[str, Any] = {"ls": "-", "lw": 1.6} if drawn else {"ls": ":", "lw": 1.2}
    panel.plot([0, needle.depth], [0, 0], color="#ff5a36", solid_capstyle="butt", **style)
    panel.plot(0, 0, marker="|", ms=9, color="#ff5a36")
    panel.plot(needle.depth, 0, marker=">" if drawn else "x", ms=5, color="#ff5a36")

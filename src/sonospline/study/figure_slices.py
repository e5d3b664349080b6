"""Fig. 2 of the paper: deformed mesh, slices of both models, their difference, and an image that follows."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields.field import Field
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.volume import Volume
from ..io.canvas import picture
from .figure_mesh import EXAGGERATION, NEEDLE, draw_lattice_3d

Array = NDArray[np.float64]

_PIXELS = 480


class Compared(NamedTuple):
    """One insertion in both models."""

    grid: Grid
    needle: Needle
    spline: Field
    """Our field."""
    reference: Array
    """(nx, ny, nz, 3) displacement by finite elements."""


def draw_slices(overview: Compared, other: Compared, image: Volume, path: Path) -> None:
    """Write Fig. 2.

    Parameters
    ----------
    overview : Compared
        Panels a, e and f.
    other : Compared
        Panels b to d.
    image : Volume
        What e and f show a slice of; it is stretched to fill the grid.
    path : Path
        File to write.
    """
    with picture(path, 17, 10.5) as figure:
        _overview(figure.add_subplot(2, 3, 1, projection="3d"), overview)
        ours = np.asarray(other.spline.on_grid("direct"))
        largest = float(np.linalg.norm(other.reference, axis=-1).max())
        panels = [figure.add_subplot(2, 3, 2), figure.add_subplot(2, 3, 3)]
        for panel, moved, title in zip(
            panels, (ours, other.reference), ("b) spline (PHS)", "c) finite elements"), strict=True
        ):
            shown = _slice(panel, other, moved, largest)
            panel.set_title(f"{title}, plane z = 0.5")
        figure.colorbar(shown, ax=panels, label="displacement (cube sides)", shrink=0.85)
        _histogram(figure.add_subplot(2, 3, 4), ours, other.reference)
        before, after = _images(overview, image)
        for number, shades, title in ((5, before, "e) image before"), (6, after, "f) image after")):
            panel = figure.add_subplot(2, 3, number)
            panel.imshow(shades.T, cmap="gray", origin="lower", extent=_extent(overview.grid))
            if number == 6:
                _needle_2d(panel, overview.needle)
            panel.set_facecolor("0.15")  # where tissue came in from outside the image
            panel.set_title(f"{title} the insertion, plane z = 0.5")


def _overview(panel: Any, compared: Compared) -> None:
    grid = compared.grid
    draw_lattice_3d(panel, grid, np.asarray(compared.spline.on_grid("direct")))
    low, high = grid.points.min(axis=0), grid.points.max(axis=0)
    x, y = np.meshgrid([low[0], high[0]], [low[1], high[1]])
    panel.plot_surface(x, y, np.full_like(x, (low[2] + high[2]) / 2), color="#3b7dd8", alpha=0.25)
    panel.plot(*np.stack([compared.needle.entry, compared.needle.tip]).T, color=NEEDLE, lw=2.5)
    panel.set_box_aspect(grid.extent)
    panel.view_init(elev=24, azim=-64)
    panel.set_title(f"a) mesh deformed by the spline (x {EXAGGERATION}), and a slice plane")


def _slice(panel: Any, compared: Compared, moved: Array, largest: float) -> Any:
    grid = compared.grid
    middle = grid.shape[2] // 2
    nodes = (grid.points.reshape(*grid.shape, 3) + moved)[:, :, middle, :2]
    size = np.linalg.norm(moved[:, :, middle], axis=-1)
    shown = panel.pcolormesh(*np.moveaxis(nodes, -1, 0), size, shading="gouraud", cmap="viridis", vmin=0, vmax=largest)
    for lines in (nodes, np.swapaxes(nodes, 0, 1)):
        for line in lines:
            panel.plot(*line.T, color="white", lw=0.35, alpha=0.6)
    _needle_2d(panel, compared.needle)
    panel.set_aspect("equal")
    return shown


def _histogram(panel: Any, ours: Array, reference: Array) -> None:
    error = np.linalg.norm(ours - reference, axis=-1)[reference.any(axis=-1)]
    panel.hist(1e3 * error, bins=60, color="#1f6fb4")
    panel.axvline(1e3 * error.mean(), color=NEEDLE, label=f"mean {1e3 * error.mean():.2f}e-3")
    panel.axvline(
        1e3 * np.sqrt((error**2).mean()), color=NEEDLE, ls="--", label=f"rms {1e3 * np.sqrt((error**2).mean()):.2f}e-3"
    )
    panel.set_title(f"d) nodal error, {len(error):,} nodes that move")
    panel.set_xlabel("|u(PHS) - u(FEM)| (1e-3 cube sides)")
    panel.set_ylabel("nodes")
    panel.set_yscale("log")
    panel.legend()


def _images(compared: Compared, image: Volume) -> tuple[Array, Array]:
    """The image on the plane z = 0.5, undeformed, and as the deformed tissue shows it there."""
    grid = compared.grid
    low, high = grid.points.min(axis=0), grid.points.max(axis=0)
    x, y = (np.linspace(a, b, _PIXELS) for a, b in zip(low[:2], high[:2], strict=True))
    plane = np.stack(np.broadcast_arrays(x[:, None], y, (low[2] + high[2]) / 2), axis=-1).reshape(-1, 3)
    undeformed = compared.spline.inverse(plane, tolerance=1e-5)

    def sampled(points: Array) -> Array:
        inside = (points - low) / (high - low)
        world = image.lattice.world(inside * image.lattice.extent)
        return image.sample(world).reshape(_PIXELS, _PIXELS)

    return sampled(plane), sampled(undeformed)


def _extent(grid: Grid) -> tuple[float, float, float, float]:
    low, high = grid.points.min(axis=0), grid.points.max(axis=0)
    return (low[0], high[0], low[1], high[1])


def _needle_2d(panel: Any, needle: Needle) -> None:
    panel.plot(*np.stack([needle.entry, needle.tip])[:, :2].T, color=NEEDLE, lw=2)
    panel.set_xlabel("x")
    panel.set_ylabel("y")

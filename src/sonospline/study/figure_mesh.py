"""Fig. 1 of the paper: the mesh, its deformation, and the nodes that tip and shaft displace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fields.field import Field
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..io.canvas import picture
from ..mechanics.interaction import NeedleTissueModel, shaft_displacement, tip_displacement
from ..models.spline.insertion import Insertion

Array = NDArray[np.float64]

NEEDLE = "#e0321c"
SHAFT, TIP, REST = "#1f6fb4", "#f08a00", "0.75"
EXAGGERATION = 3
_LINES = 9
"""About so many lattice lines are drawn along each axis."""


def draw_mesh(tissue: Tissue, needle: Needle, model: NeedleTissueModel, path: Path) -> None:
    """Write Fig. 1: source and target points, deformed mesh, tip region across, shaft region along the needle.

    Displacements are drawn in their true size, except where a title says otherwise.
    """
    grid = tissue.grid
    field = Insertion(tissue, model).advance(needle)
    shaft = shaft_displacement(grid.points, needle, model)
    tip = tip_displacement(grid.points, needle, model)
    with picture(path, 12, 11) as figure:
        panels = [figure.add_subplot(2, 2, 1, projection="3d"), figure.add_subplot(2, 2, 2, projection="3d")]
        _sources_and_targets(panels[0], grid, needle, shaft + tip)
        _deformed_mesh(panels[1], grid, needle, field)
        _tip_region(figure.add_subplot(2, 2, 3), grid, needle, model, tip)
        _shaft_region(figure.add_subplot(2, 2, 4), grid, needle, shaft, tip)


def _sources_and_targets(panel: Any, grid: Grid, needle: Needle, moved: Array) -> None:
    thin = _every(grid, _LINES + 3)
    points = grid.points.reshape(*grid.shape, 3)[thin].reshape(-1, 3)
    moves = moved.reshape(*grid.shape, 3)[thin].reshape(-1, 3)
    active = moves.any(axis=1)
    panel.scatter(*points[~active].T, s=1, color=REST)
    panel.scatter(*points[active].T, s=3, color=SHAFT, label="source")
    panel.quiver(*points[active].T, *moves[active].T, color=TIP, lw=0.9, arrow_length_ratio=0.4, label="to its target")
    panel.legend(loc="upper left")
    _finish_3d(panel, grid, needle, "a) source and target points")


def _deformed_mesh(panel: Any, grid: Grid, needle: Needle, field: Field) -> None:
    draw_lattice_3d(panel, grid, np.asarray(field.on_grid("direct")))
    _finish_3d(panel, grid, needle, f"b) deformed mesh, displacement x {EXAGGERATION}")


def draw_lattice_3d(panel: Any, grid: Grid, displacement: Array, *, color: str = "0.45") -> None:
    """Draw lines of the lattice, deformed ``EXAGGERATION`` times: its faces and the middle plane across z."""
    nodes = grid.points.reshape(*grid.shape, 3) + EXAGGERATION * displacement
    step = max(1, (min(grid.shape) - 1) // _LINES)
    middle = grid.shape[2] // 2
    for axis in range(3):
        sheets = (0, grid.shape[axis] - 1) + ((middle,) if axis == 2 else ())
        for sheet in sheets:
            plane = np.take(nodes, sheet, axis=axis)
            inner = axis == 2 and sheet == middle
            style = {"color": SHAFT if inner else color, "lw": 0.7 if inner else 0.35}
            for lines in (plane[::step], np.swapaxes(plane, 0, 1)[::step]):
                for line in lines:
                    panel.plot(*line.T, **style)


def _tip_region(panel: Any, grid: Grid, needle: Needle, model: NeedleTissueModel, tip: Array) -> None:
    from matplotlib.patches import Circle

    across = _frame(needle)[1:]
    seen = needle.project(grid.points)
    ahead = seen.along - needle.depth
    near = (ahead > 0) & (ahead <= model.tip_length) & (seen.distance <= 4 * model.tip_radius)
    flat = (grid.points - needle.entry) @ np.transpose(across)
    pushed = tip.any(axis=1)
    panel.scatter(*flat[near & ~pushed].T, s=14, color=REST, label="not displaced by the tip")
    panel.scatter(*flat[pushed].T, s=26, color=TIP, label="displaced by the tip, towards you")
    panel.add_patch(Circle((0, 0), model.tip_radius, fill=False, color=NEEDLE, ls="--"))
    panel.plot(0, 0, "+", color=NEEDLE, ms=10, label="needle")
    _finish_2d(panel, "c) ahead of the tip, seen along the needle", "across", "across")


def _shaft_region(panel: Any, grid: Grid, needle: Needle, shaft: Array, tip: Array) -> None:
    along, across, out = _frame(needle)
    offset = grid.points - needle.entry
    in_plane = np.abs(offset @ out) <= 0.51 * max(grid.spacing)
    for moves, color, label in ((shaft, SHAFT, "by the shaft"), (tip, TIP, "by the tip")):
        chosen = in_plane & moves.any(axis=1)
        panel.quiver(
            *(offset[chosen] @ np.column_stack([along, across])).T,
            *(moves[chosen] @ np.column_stack([along, across])).T,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.003,
            color=color,
            label=label,
        )
    still = in_plane & ~(shaft.any(axis=1) | tip.any(axis=1))
    panel.scatter(*(offset[still] @ np.column_stack([along, across])).T, s=3, color=REST, label="not displaced")
    panel.plot([0, needle.depth], [0, 0], color=NEEDLE, lw=2, label="needle")
    _finish_2d(panel, "d) in the needle's plane: drag and pull", "along the needle", "across")


def _frame(needle: Needle) -> tuple[Array, Array, Array]:
    """Unit vectors along the needle and across it, the second as near to y as can be."""
    along = needle.direction
    upright = np.eye(3)[1 if abs(along[1]) < 0.9 else 2]
    across = upright - (upright @ along) * along
    across /= np.linalg.norm(across)
    return along, across, np.cross(along, across)


def _every(grid: Grid, most: int) -> tuple[slice, ...]:
    return tuple(slice(None, None, max(1, (n - 1) // most)) for n in grid.shape)


def _finish_3d(panel: Any, grid: Grid, needle: Needle, title: str) -> None:
    panel.plot(*np.stack([needle.entry, needle.tip]).T, color=NEEDLE, lw=2)
    panel.set_box_aspect(grid.extent)
    panel.view_init(elev=22, azim=-62)
    panel.set_title(title)
    panel.set_xlabel("x")
    panel.set_ylabel("y")
    panel.set_zlabel("z")


def _finish_2d(panel: Any, title: str, x: str, y: str) -> None:
    panel.set_aspect("equal")
    panel.set_title(title)
    panel.set_xlabel(f"{x} (cube sides)")
    panel.set_ylabel(f"{y} (cube sides)")
    panel.legend(loc="upper right", fontsize=8)

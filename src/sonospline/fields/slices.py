"""What a field looks like on a plane: the paper's slice through nodes, and the continuous one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._extras import require
from .._shown import size
from ..geometry import pose
from ..geometry.bent_needle import BentNeedle
from ..geometry.needle import Needle
from ..geometry.plane import ImagePlane
from ..io.canvas import axes_or_new
from .maps import FieldMaps
from .sampled_maps import SampledMaps

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class NodeSlice:
    """Nodes of the deformed volume on a plane, the needle projected on it (Sec. V, Fig. 2 a-b).

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.fields import NodeSlice
    >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> field = insertion.advance(ss.Needle((0, .5, .5), (.6, .5, .5)))
    >>> NodeSlice.of(field, axis="z", at=0.5).deformed.shape
    (25, 25, 3)
    """

    nodes: Array
    """(rows, columns, 3) undeformed nodes of the layer in the plane's coordinates: x, y, distance."""
    deformed: Array
    """(rows, columns, 3) where they are now; z is how far they left the plane."""
    plane: ImagePlane

    @classmethod
    def of(cls, field: FieldMaps, *, axis: str = "z", at: float) -> NodeSlice:
        """Return the layer of nodes nearest to a lattice coordinate.

        Parameters
        ----------
        field : Field
            A field that knows its grid.
        axis : {"x", "y", "z"}
            Lattice axis across the slice.
        at : float
            Distance from node 0 along that axis, mm.
        """
        grid = field.grid
        if grid is None:
            raise ValueError("field.grid = None: fit the field with grid= to slice its nodes")
        across = "xyz".index(_validate.choice("axis", axis, ("x", "y", "z")))
        layer = round(float(at) / grid.spacing[across])
        if not 0 <= layer < grid.shape[across]:
            raise ValueError(f"at = {at} lies outside the grid; give 0 to {grid.extent[across]:g} along {axis}")
        along = [a for a in range(3) if a != across]
        nodes = np.moveaxis(grid.points.reshape(*grid.shape, 3), across, 0)[layer]
        moved = nodes + np.moveaxis(field.on_grid(), across, 0)[layer]
        # rows are the second axis, columns the first, as in a picture
        nodes, moved = nodes.swapaxes(0, 1), moved.swapaxes(0, 1)
        right, down = grid.direction[:, along[0]], grid.direction[:, along[1]]
        plane = ImagePlane(
            image_to_reference=pose.facing(nodes[0, 0], depth=down, right=right),
            shape=nodes.shape[:2],
            spacing_mm=(grid.spacing[along[0]], grid.spacing[along[1]]),
        )
        flat, now = (plane.project(p.reshape(-1, 3)).reshape(p.shape) for p in (nodes, moved))
        return cls(flat, now, plane)

    def __repr__(self) -> str:
        return f"NodeSlice({size(self.plane.shape)} nodes)"

    @property
    def displacement(self) -> Array:
        """(rows, columns, 3) displacement in the plane's coordinates."""
        return self.deformed - self.nodes

    def plot(self, ax: Any = None, *, needle: Needle | None = None, lines: bool = True) -> Any:
        """Draw the deformed nodes, joined by grid lines, and the needle, on matplotlib ``Axes``; return them."""
        ax = axes_or_new(ax)
        x, y = self.deformed[..., 0], self.deformed[..., 1]
        if lines:
            ax.plot(x, y, color="#4477aa", lw=0.4)
            ax.plot(x.T, y.T, color="#4477aa", lw=0.4)
        ax.scatter(x, y, s=1.5, color="#223355", linewidths=0)
        return _finish(ax, self.plane, needle)

    def to_pyvista(self) -> Any:
        """Return a ``pyvista.StructuredGrid`` of the deformed nodes in the world, with their displacement."""
        world = pose.to_reference(self.plane.axes_to_reference, self.deformed.reshape(-1, 3))
        rotation = self.plane.image_to_reference[:3, :3]
        return _surface(world.reshape(self.deformed.shape), self.displacement @ rotation.T)


@dataclass(frozen=True, eq=False, repr=False)
class PlaneSlice:
    """A field on every pixel of a plane in the deformed tissue, through the inverse map.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.geometry import ImagePlane
    >>> from sonospline.fields import PlaneSlice
    >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> field = insertion.advance(ss.Needle((0, .5, .5), (.6, .5, .5)))
    >>> plane = ImagePlane.crossing(field.grid, normal=(0, 0, 1), through=(.5, .5, .5), pixels=64)
    >>> PlaneSlice.of(field, plane).magnitude.shape
    (64, 64)
    """

    displacement: Array
    """(rows, columns, 3) displacement, in the plane's coordinates, of what is now at each pixel; NaN where unknown."""
    plane: ImagePlane
    field: FieldMaps

    @classmethod
    def of(cls, field: FieldMaps, plane: ImagePlane) -> PlaneSlice:
        """Return the slice; a field that is not on a grid already is sampled on its grid first."""
        sampled = field if isinstance(field, SampledMaps) or field.grid is None else SampledMaps.of(field)
        points = plane.points
        moved = (points - sampled.inverse(points)) @ plane.image_to_reference[:3, :3]
        if sampled.grid is not None:
            moved[~sampled.grid.contains(points)] = np.nan
        return cls(moved.reshape(*plane.shape, 3), plane, sampled)

    def __repr__(self) -> str:
        return f"PlaneSlice({size(self.plane.shape)} pixels of {self.field!r})"

    @cached_property
    def magnitude(self) -> Array:
        """(rows, columns) length of the displacement."""
        return np.linalg.norm(self.displacement, axis=-1)

    def grid_lines(self, step_mm: float) -> list[Array]:
        """Return lines (m, 2) of the plane, ``step_mm`` apart before the deformation, as they run now."""
        _validate.number("step_mm", step_mm, positive=True)
        left, right, bottom, top = self.plane.extent
        across, down = np.arange(left, right, step_mm), np.arange(top, bottom, step_mm)
        fine_x, fine_y = np.linspace(left, right, 200), np.linspace(top, bottom, 200)
        flat = [np.column_stack([np.full(200, x), fine_y]) for x in across]
        flat += [np.column_stack([fine_x, np.full(200, y)]) for y in down]
        world = pose.to_reference(
            self.plane.axes_to_reference, np.column_stack([np.concatenate(flat), np.zeros(200 * len(flat))])
        )
        now = self.plane.project(self.field.forward(world))[:, :2]
        return list(now.reshape(len(flat), 200, 2))

    def plot(
        self,
        ax: Any = None,
        *,
        needle: Needle | None = None,
        arrows: int = 24,
        lines_mm: float | None = None,
        colour_bar: bool = True,
    ) -> Any:
        """Draw magnitude, arrows, deformed grid lines and the needle on matplotlib ``Axes``; return them.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; by default on a new figure.
        needle : Needle, optional
            Drawn as projected on the plane.
        arrows : int, default: 24
            Arrows along the longer side; 0 draws none.
        lines_mm : float, optional
            Draw grid lines that were so far apart before the deformation.
        colour_bar : bool, default: True
            Whether to add the scale of the magnitude.
        """
        ax = axes_or_new(ax)
        shown = ax.imshow(self.magnitude, origin="upper", extent=self.plane.extent, cmap="viridis", vmin=0)
        if colour_bar:
            ax.figure.colorbar(shown, ax=ax, label="displacement (mm)")
        if lines_mm is not None:
            for line in self.grid_lines(lines_mm):
                ax.plot(*line.T, color="white", lw=0.4, alpha=0.6)
        if arrows:
            every = max(1, max(self.plane.shape) // arrows)
            rows, columns = (np.arange(every // 2, n, every) for n in self.plane.shape)
            x = self.plane.corner_mm[0] + self.plane.spacing_mm[0] * columns
            y = self.plane.corner_mm[1] + self.plane.spacing_mm[1] * rows
            u, v, _ = np.moveaxis(self.displacement[np.ix_(rows, columns)], -1, 0)
            ax.quiver(x, y, u, v, angles="xy", color="white", width=0.003)
        return _finish(ax, self.plane, needle)

    def to_pyvista(self) -> Any:
        """Return a ``pyvista.StructuredGrid`` of the pixels in the world, with displacement and magnitude."""
        rotation = self.plane.image_to_reference[:3, :3]
        return _surface(self.plane.points.reshape(*self.plane.shape, 3), self.displacement @ rotation.T)


def _finish(ax: Any, plane: ImagePlane, needle: Needle | None) -> Any:
    left, right, bottom, top = plane.extent
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    ax.set_aspect("equal")
    ax.set_xlabel("mm")
    ax.set_ylabel("mm")
    if needle is not None:
        draw_needle(ax, plane, needle)
    return ax


def _surface(points: Array, displacement: ArrayLike) -> Any:
    """A PyVista surface of points (rows, columns, 3) that carries displacement vectors."""
    surface = require("pyvista").StructuredGrid(*(points[..., a][..., None] for a in range(3)))
    # PyVista numbers points with the first index fastest
    vectors = np.asarray(displacement).swapaxes(0, 1).reshape(-1, 3)
    surface["displacement"] = vectors
    surface["magnitude"] = np.linalg.norm(vectors, axis=1)
    return surface


def draw_needle(ax: Any, plane: ImagePlane, needle: Needle | BentNeedle) -> None:
    """Draw a needle's foot on a plane: the shaft from its entry to its tip."""
    x, y, _ = plane.project(needle.points).T
    ax.plot(x, y, color="#ff5a36", lw=1.4, solid_capstyle="butt")
    ax.plot(x[-1], y[-1], marker=".", ms=5, color="#ff5a36")


def plot_slice(
    field: FieldMaps, ax: Any, through: Needle | ArrayLike | None, normal: ArrayLike | None, style: dict[str, Any]
) -> Any:
    """Draw a field on the plane through a needle, or a point, as :meth:`Field.plot` says."""
    grid = field.require_grid()
    needle = through if isinstance(through, Needle) else None
    across = None if normal is None else _validate.vector("normal", normal)
    if needle is not None:
        across = _across(needle, grid.direction.T, across)
        where, right = needle.tip, needle.direction
    else:
        where = _most_moved(field) if through is None else _validate.vector("through", through)  # type: ignore[arg-type]
        across, right = grid.direction[:, 2] if across is None else across, None
    plane = ImagePlane.crossing(grid, normal=across, through=where, right=right)
    return PlaneSlice.of(field, plane).plot(ax, needle=needle, **style)


def _across(needle: Needle, axes: Array, normal: Array | None) -> Array:
    """The part across a needle of a direction, by default of the lattice axis that has the largest."""
    wanted = axes[int(np.argmin(np.abs(axes @ needle.direction)))] if normal is None else normal
    across = wanted - (wanted @ needle.direction) * needle.direction
    if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(wanted):
        raise ValueError(f"normal = {wanted.tolist()} is zero or along the needle; give a direction across it")
    return across


def _most_moved(field: FieldMaps) -> Array:
    grid = field.require_grid()
    lengths = np.linalg.norm(field.on_grid(), axis=-1)
    return grid.node(np.unravel_index(int(lengths.argmax()), grid.shape))

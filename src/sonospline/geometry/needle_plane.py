"""A plane through the needle: its own flat lattice, and where the tissue's nodes lie seen from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .grid import FACES
from .needle import Needle
from .tissue import Tissue

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NeedlePlane:
    """The part of a plane that lies in the tissue: a rectangle, with nodes as far apart as the grid's.

    The plane holds the needle and the axis of the entry face that the needle leans
    towards least. For a straight needle in the paper's cube it is z = constant, the slice
    of Fig. 2.
    """

    origin: Array
    """(3,) a corner, in the lattice's coordinates."""
    axes: Array
    """(2, 3) unit vectors of its two edges: away from the entry face, and along it."""
    lengths: Array
    """(2,) of the edges."""
    nodes: Array
    """(m, 2) places of its nodes along the edges, from the corner."""
    on_pinned_edge: NDArray[np.bool_]
    """(m,) nodes where the plane leaves the tissue, all but those inside the entry face."""

    @classmethod
    def through(cls, needle: Needle, tissue: Tissue) -> NeedlePlane:
        """Return the plane of a needle that starts on the entry face."""
        grid = tissue.grid
        depth_axis = FACES.index(tissue.entry_face) // 2
        entry, tip = grid.local(np.stack([needle.entry, needle.tip]))
        direction = (tip - entry) / needle.depth
        face_axes = [(depth_axis + 1) % 3, (depth_axis + 2) % 3]
        kept = min(face_axes, key=lambda axis: (round(abs(direction[axis]), 9), face_axes.index(axis)))
        inward = direction.copy()
        inward[kept] = 0.0
        inward /= np.linalg.norm(inward)
        with np.errstate(divide="ignore", invalid="ignore"):
            ways = np.where(inward > 0, (grid.extent - entry) / inward, -entry / inward)
        lengths = np.array([np.min(ways[np.abs(inward) > 1e-12]), grid.extent[kept]])
        origin = entry.copy()
        origin[kept] = 0.0
        counts = np.maximum(np.rint(lengths / min(grid.spacing)).astype(int) + 1, 2)
        first, second = (np.linspace(0, length, n) for length, n in zip(lengths, counts, strict=True))
        nodes = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)
        pinned = np.zeros(nodes.shape[:2], bool)
        pinned[-1], pinned[:, 0], pinned[:, -1] = True, True, True
        return cls(origin, np.stack([inward, np.eye(3)[kept]]), lengths, nodes.reshape(-1, 2), pinned.ravel())

    @property
    def normal(self) -> Array:
        """(3,) unit vector off the plane, in the lattice's coordinates."""
        return np.cross(*self.axes)

    def local(self, places: Array) -> Array:
        """Return positions along the lattice (m, 3) of places (m, 2) in the plane."""
        return self.origin + places @ self.axes

    def seen(self, local: Array) -> tuple[Array, Array]:
        """Return the places (m, 2) in the plane of positions along the lattice (m, 3), and distances (m,) off it."""
        offset = local - self.origin
        return offset @ self.axes.T, np.abs(offset @ self.normal)

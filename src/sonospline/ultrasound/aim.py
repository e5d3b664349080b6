"""What a probe at a pose sees of a phantom, sorted by the cells of a displacement lattice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry import pose
from ..geometry.grid import Grid
from .interfaces import WIDTH
from .optics import Optics
from .phantom import Phantom
from .scatterers import PER_BRICK

Array = NDArray[np.float64]


class Aim(NamedTuple):
    """The arguments of the core's ``BmodePlan.aim``."""

    frames: NDArray[np.float32]
    """(cells, 16): rotation from lattice axes to lateral, elevation, axial; range, line, carrier cycles, distance
    from the apex and elevation of the cell's first corner."""
    nodes: NDArray[np.int32]
    """(cells, 4): first node, and how many nodes further the opposite corner lies along each axis."""
    starts: NDArray[np.int32]
    """(cells + 1,) first scatterer of each cell."""
    place: NDArray[np.uint16]
    """(3, scatterers) place within the cell, of 65536."""
    amplitude: NDArray[np.int16]
    amplitude_step: float
    ray_start: Array
    ray_step: Array
    labels: NDArray[np.uint8]
    label_index: Array
    loss_db: NDArray[np.float32]
    impedance: NDArray[np.float32]
    surface_starts: NDArray[np.int32]
    """(cells + 1,) first of the scatterers on surfaces, which are the last of each cell."""
    surfaces: NDArray[np.float32]
    """(5, surfaces) normal along the lattice's axes times its spacing; amplitude of mirror and of scatter."""
    surface_width: float


def aim(
    phantom: Phantom,
    optics: Optics,
    transform: Array,
    grid: Grid,
    margin_mm: float,
    seed: int,
    *,
    diffuse: bool = False,
    power: Array | None = None,
) -> Aim:
    """Return the scatterers within a slice and ``margin_mm`` around it, and the rays that attenuation is traced along.

    Cells go on beyond the grid, where the displacement is that of its nearest point. Surfaces echo in proportion to
    the root of ``power``, the probe's own speckle by default.
    """
    lattice, spacing = phantom.labels.lattice, np.array(grid.spacing)
    to_image, origin = transform[:3, :3].T, transform[:3, 3]
    to_cell = grid.direction.T / spacing[:, None]
    frames, nodes, starts, place, amplitude, amplitude_step, surface_starts, surfaces = phantom.echoes.choose(
        optics.view(margin_mm, PER_BRICK),
        np.column_stack([to_image @ lattice.direction, to_image @ (lattice.origin - origin)]),
        np.column_stack([to_cell @ lattice.direction, to_cell @ (lattice.origin - grid.origin)]),
        np.column_stack([to_image @ grid.direction * spacing, to_image @ (grid.origin - origin)]),
        grid.shape,
        grid.spacing,
        optics.speckle_power if power is None else power,
        seed,
        diffuse,
    )
    two_way = 2 * optics.probe.frequency_mhz * optics.probe.depth_mm / optics.ray_samples / 10
    return Aim(
        frames,
        nodes,
        starts,
        place,
        amplitude,
        amplitude_step,
        *_rays(optics, transform, grid),
        phantom.bytes,
        _label_index(phantom, grid),
        (two_way * phantom.table("attenuation_db_cm_mhz")).astype(np.float32),
        phantom.table("impedance").astype(np.float32),
        surface_starts,
        surfaces,
        WIDTH,
    )


def _rays(optics: Optics, transform: Array, grid: Grid) -> tuple[Array, Array]:
    """Middle of the first coarse sample of each coarse beam, and the step, in the lattice's coordinates."""
    probe = optics.probe
    rays, step = optics.rays, probe.depth_mm / optics.ray_samples
    line = np.linspace(0, probe.lines - 1, rays)
    ends = [
        grid.local(
            pose.to_reference(transform, probe.image_points(np.column_stack([np.full(rays, r), line, np.zeros(rays)])))
        )
        for r in (0.5 * step, 1.5 * step)
    ]
    return ends[0], ends[1] - ends[0]


def _label_index(phantom: Phantom, grid: Grid) -> Array:
    lattice = phantom.labels.lattice
    to_index = lattice.direction.T / np.array(lattice.spacing)[:, None]
    return np.column_stack([to_index @ grid.direction, to_index @ (grid.origin - lattice.origin)])

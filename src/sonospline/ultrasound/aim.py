"""What a probe at a pose sees of a scene, sorted by the cells of a displacement lattice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..grid import Grid
from . import pose
from .optics import RAY_SAMPLES, RAYS, Optics
from .scatterers import Scatterers
from .scene import Scene

Array = NDArray[np.float64]

_SLACK = 64
_FULL = 32000


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


def aim(scene: Scene, optics: Optics, transform: Array, grid: Grid, scatterers: Scatterers) -> Aim:
    """Return scatterers sorted by cell and from left to right, with the rays that attenuation is traced along.

    Cells go on beyond the grid, where the displacement is that of its nearest point.
    """
    spacing = np.array(grid.spacing)
    index = grid.local(scatterers.points) / spacing
    cell = np.floor(index).astype(np.int64)
    place = np.minimum((index - cell) * 65536, 65535).astype(np.uint16)
    cells, which = _unique(cell)
    frames = _frames(cells, optics, transform, grid)
    order = np.argsort(frames[:, 10], kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    which = rank[which]
    sort = np.argsort(which, kind="stable")
    starts = np.searchsorted(which[sort], np.arange(len(cells) + 1)).astype(np.int32)
    largest = float(np.abs(scatterers.amplitude).max(initial=1e-12))
    amplitude = np.rint(scatterers.amplitude[sort] * (_FULL / largest)).astype(np.int16)
    two_way = 2 * optics.probe.frequency_mhz * optics.probe.depth_mm / RAY_SAMPLES / 10
    return Aim(
        np.ascontiguousarray(frames[order], np.float32),
        _nodes(cells[order], grid),
        starts,
        np.ascontiguousarray(np.pad(place[sort].T, ((0, 0), (0, _SLACK)))),
        np.pad(amplitude, (0, _SLACK)),
        largest / _FULL,
        *_rays(optics, transform, grid),
        scene.bytes,
        _label_index(scene, grid),
        (two_way * scene.table("attenuation_db_cm_mhz")).astype(np.float32),
        scene.table("impedance").astype(np.float32),
    )  # fmt: skip


def _unique(cell: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Distinct rows (n, 3), and which of them each row is."""
    if not len(cell):
        return cell, np.zeros(0, np.int64)
    low = cell.min(axis=0)
    size = cell.max(axis=0) - low + 1
    key = np.ravel_multi_index(tuple((cell - low).T), tuple(size))
    held = np.flatnonzero(np.bincount(key, minlength=1))
    number = np.zeros(int(np.prod(size)), np.int64)
    number[held] = np.arange(len(held))
    return np.stack(np.unravel_index(held, tuple(size)), axis=1) + low, number[key]


def _frames(cells: NDArray[np.int64], optics: Optics, transform: Array, grid: Grid) -> Array:
    probe = optics.probe
    corner = pose.to_image(transform, grid.node(cells))
    r, line, z = probe.beam_coordinates(corner).T
    angle = (line - (probe.lines - 1) / 2) * probe.line_step if probe.curved else np.zeros(len(cells))
    cos, sin, zero, one = np.cos(angle), np.sin(angle), np.zeros(len(cells)), np.ones(len(cells))
    # rows: lateral, elevation, axial in the image frame (x right, y deep, z out of the plane)
    local = np.stack([cos, -sin, zero, zero, zero, one, sin, cos, zero], axis=1).reshape(-1, 3, 3)
    rotation = local @ (transform[:3, :3].T @ grid.direction)
    cycles = r * optics.cycles_per_mm
    cycles -= np.rint(cycles)
    return np.column_stack([rotation.reshape(-1, 9), r, line, cycles, r + probe.apex_mm, z, zero, zero])


def _nodes(cells: NDArray[np.int64], grid: Grid) -> NDArray[np.int32]:
    last = np.array(grid.shape) - 1
    low, high = np.clip(cells, 0, last), np.clip(cells + 1, 0, last)
    strides = np.array([grid.shape[1] * grid.shape[2], grid.shape[2], 1])
    return np.column_stack([low @ strides, (high - low) * strides]).astype(np.int32)


def _rays(optics: Optics, transform: Array, grid: Grid) -> tuple[Array, Array]:
    """Middle of the first coarse sample of each coarse beam, and the step, in the lattice frame."""
    probe = optics.probe
    step = probe.depth_mm / RAY_SAMPLES
    line = np.linspace(0, probe.lines - 1, RAYS)
    ends = [
        grid.local(
            pose.to_reference(transform, probe.image_points(np.column_stack([np.full(RAYS, r), line, np.zeros(RAYS)])))
        )
        for r in (0.5 * step, 1.5 * step)
    ]
    return ends[0], ends[1] - ends[0]


def _label_index(scene: Scene, grid: Grid) -> Array:
    lattice = scene.labels.lattice
    to_index = lattice.direction.T / np.array(lattice.spacing)[:, None]
    return np.column_stack([to_index @ grid.direction, to_index @ (grid.origin - lattice.origin)])

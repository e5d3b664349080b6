"""NumPy twin of the core's choice of scatterers."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .checks import MOST_NODES, numbered, require, require_spacing
from .interfaces import find_interfaces, interface_copies, largest_face
from .surfaces import Points, layered, scattered

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Words = NDArray[np.uint64]
Echoes = tuple[NDArray[np.floating], Array]
"""Places (m, 3) in the lattice's coordinates in mm, and amplitudes (m,)."""

_STRIP_LINES = 32
_SLACK = 64
_FULL = 32000
_BRICK_BITS = 6
_MOST_IN_BRICK, _MOST_SMOOTHING = 512, 64


class View(NamedTuple):
    """What :meth:`EchoScene.choose` takes as ``probe``, with what follows from it."""

    curved: float
    apex_mm: float
    depth_mm: float
    half_angle: float
    half_width_mm: float
    line_step: float
    lines: float
    beside_mm: float
    cycles_per_mm: float
    elevation_mm: float
    spread: float
    focus_mm: float
    cut: float
    cell_mm2: float
    f_number: float
    aperture_mm: float
    margin_mm: float
    brick_mm: float
    sample_mm: float
    points_per_mm2: float
    lateral_mm: float
    faintest: float

    def ranges(self, seen: Array) -> Array:
        """Distance of image points from the probe's face along the beams."""
        return np.hypot(seen[:, 0], seen[:, 1] + self.apex_mm) - self.apex_mm if self.curved else seen[:, 1]

    def hears(self, seen: Array, r: Array, slack: float) -> NDArray[np.bool_]:
        """Which image points may reach a beam once displaced by ``slack``."""
        near = (r > -slack - 1) & (r < self.depth_mm + slack + 1)
        beside = np.abs(seen[:, 0]) * np.cos(self.half_angle) - (seen[:, 1] + self.apex_mm) * np.sin(self.half_angle)
        near &= beside - self.half_width_mm < slack + self.beside_mm
        away = np.minimum(np.abs(r - self.focus_mm) + slack, 2 * self.depth_mm)
        return near & (np.abs(seen[:, 2]) < self.cut * np.hypot(self.elevation_mm, self.spread * away) + slack)

    def volume(self, range_mm: Array) -> Array:
        """Tissue in mm^3 that one scatterer stands for."""
        r = np.clip(range_mm, 0, self.depth_mm)
        across = np.maximum(self.f_number, r / self.aperture_mm)
        return self.cell_mm2 * across * np.hypot(self.elevation_mm, self.spread * (r - self.focus_mm))


class EchoScene:
    """Labels, what they echo, and shared random patterns; :meth:`choose` takes what a probe may hear.

    ``interfaces`` holds: smoothing in voxels, smallest and largest reflection, points per mm^2, gain, width of
    the fall with angle, and the faintest echo over speckle.
    """

    def __init__(
        self,
        labels: NDArray[np.uint8],
        spacing: tuple[float, float, float],
        impedance: Array,
        rough: Array,
        wall_mm: Array,
        wall_impedance: float,
        opaque: Array,
        level_db: Array,
        texture_db: Array,
        texture_kind: Array,
        texture_map: Array,
        texture: Floats,
        places: Floats,
        signs: Floats,
        interfaces: tuple[float, ...],
        no_echo: float,
    ) -> None:
        require_spacing(spacing)
        side, patterns = texture.shape[1], len(places)
        require(side >= 2 and texture.shape[1:] == (side,) * 3, "texture is no cubes of 2 or more")
        known = ((texture_kind >= 0) & (texture_kind < len(texture))).all()
        require(bool(known), "texture_kind has a number that is no texture's")
        require(
            patterns > 0 and patterns & (patterns - 1) == 0 and signs.shape == (patterns, places.shape[2]),
            "places and signs differ in length, or are no power of two",
        )
        require(signs.shape[1] <= _MOST_IN_BRICK, "signs has more than 512 columns")
        require(
            bool(np.isfinite(interfaces).all()) and 0 < interfaces[0] <= _MOST_SMOOTHING and interfaces[3] >= 0,
            "interfaces is not finite, or smoothing not between 0 and 64 voxels, or points_per_mm2 below 0",
        )
        self.labels, self.spacing, self.impedance = labels, np.array(spacing), impedance
        self.rough, self.wall_mm, self.wall_impedance = rough, wall_mm, wall_impedance
        self.opaque = opaque
        self.level_db, self.texture_db, self.texture = level_db, texture_db, texture
        self.texture_kind, self.texture_map = texture_kind, texture_map
        self.places, self.signs, self.numbers, self.no_echo = places, signs, interfaces, no_echo

    def interfaces(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return points (m, 3) in the lattice's coordinates, normals (m, 3), reflection (m,), area (m,) in mm^2."""
        points, normals, reflection, area = (np.ascontiguousarray(p, np.float32) for p in self._interfaces[:4])
        return points, normals, reflection, area

    def prepare(self) -> None:
        """Find all interfaces before a view asks for them."""
        self.interfaces()

    @cached_property
    def _interfaces(self) -> Points:
        found = find_interfaces(self.labels, self.spacing, self.impedance, *self.numbers[:4])
        points, normals, reflection, area = (part.astype(np.float32) for part in found[:4])
        return Points(points, normals, reflection, area, *found[4:])

    def choose(
        self,
        probe: tuple[float, ...],
        to_image: Array,
        to_cell: Array,
        cell_to_image: Array,
        shape: tuple[int, int, int],
        spacing: tuple[float, float, float],
        power: Array,
        seed: int,
        diffuse: bool,
    ) -> tuple[Any, ...]:
        """Return what ``BmodePlan.aim`` takes: frames, nodes, starts, place, amplitude, step, and the surfaces.

        ``to_image`` and ``to_cell`` (3, 4) take positions in the lattice's coordinates (mm) to image coordinates
        and to cells of a displacement lattice of ``shape`` and ``spacing``, ``cell_to_image`` the latter to the
        former; ``power`` is that of speckle at each sample. Where surfaces are ``diffuse`` they scatter, have walls,
        and turn with the tissue.
        """
        view = View(*probe)
        finite = all(np.isfinite(numbers).all() for numbers in (probe, to_image, to_cell, cell_to_image))
        require(finite, "probe or an affine map is not finite")
        require(
            view.brick_mm > 0 and view.sample_mm > 0 and view.line_step > 0,
            "brick_mm, sample_mm or line_step of probe is not above 0",
        )
        require(numbered(shape, 1), "shape has no node along an axis, or too many")
        require_spacing(spacing)
        require(len(power) >= 2, "power is shorter than 2")
        inside = self._volume(view, to_image, seed)
        on, size_on, normals, mirror, scatter = self._surface(view, to_image, power, diffuse)
        local, size = np.concatenate([inside[0], on]), np.concatenate([inside[1], size_on])
        index = _mapped(to_cell, local)
        cell = np.floor(index).astype(np.int64)
        place = np.minimum((index - cell) * 65536, 65535).astype(np.uint16)
        cells, which = _unique(cell)
        frames = _frames(view, cells, cell_to_image, np.array(spacing))
        # strip by strip, and down each
        order = np.lexsort((np.arange(len(cells)), frames[:, 9], np.floor(frames[:, 10] / _STRIP_LINES)))
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        which = rank[which]
        sort = np.argsort(which, kind="stable")
        starts = np.searchsorted(which[sort], np.arange(len(cells) + 1)).astype(np.int32)
        loudest = max(np.abs(size).max(initial=0), (mirror + np.abs(scatter)).max(initial=0), 1e-12)
        step = float(np.float32(loudest / _FULL))
        surfaces = np.zeros((5, _SLACK), np.float32)
        surface_starts = np.zeros(len(cells) + 1, np.int32)
        if diffuse:
            square = np.array(spacing)[:, None] ** 2
            numbers = np.vstack([to_cell[:, :3] @ normals.T * square, mirror, scatter])
            own = which[len(inside[1]) :]
            surfaces = np.pad(numbers[:, np.argsort(own, kind="stable")].astype(np.float32), ((0, 0), (0, _SLACK)))
            surface_starts[1:] = np.cumsum(np.bincount(own, minlength=len(cells)))
        return (
            np.ascontiguousarray(frames[order], np.float32),
            _nodes(cells[order], shape),
            starts,
            np.ascontiguousarray(np.pad(place[sort].T, ((0, 0), (0, _SLACK)))),
            np.pad(np.rint(size[sort] / step).astype(np.int16), (0, _SLACK)),
            step,
            surface_starts,
            np.ascontiguousarray(surfaces),
        )

    def _volume(self, view: View, to_image: Array, seed: int) -> Echoes:
        bricks = self._bricks(view, to_image)
        if not len(bricks):
            return np.zeros((0, 3)), np.zeros(0)
        side = view.brick_mm
        depth = view.ranges(_mapped(to_image, (bricks + 0.5) * side))
        key = _hash(bricks, seed)
        chance = (key >> np.uint64(40)).astype(np.float64) / 2**24
        longest = self.places.shape[2]
        count = np.minimum(np.floor(side**3 / view.volume(depth) + chance), longest).astype(np.int64)
        brick = np.repeat(np.arange(len(bricks)), count)
        number = np.arange(len(brick)) - np.repeat(np.cumsum(count) - count, count)
        pattern = np.uint64(len(self.places) - 1)
        bits = key[brick]
        place = self.places[(bits & pattern).astype(np.int64), :, number]
        mirror = ((bits[:, None] >> np.arange(_BRICK_BITS, _BRICK_BITS + 3, dtype=np.uint64)) & np.uint64(1)) > 0
        local = (bricks[brick] + np.where(mirror, 1 - place, place)) * np.float64(side)
        seen = _mapped(to_image, local)
        r = view.ranges(seen)
        kept = view.hears(seen, r, view.margin_mm)
        sign = self.signs[((bits >> np.uint64(_BRICK_BITS + 3)) & pattern).astype(np.int64), number]
        level = self._level_db(local[kept], (bits + number.astype(np.uint64))[kept])
        size: Array = sign[kept] * 10 ** (level / 20) * np.sqrt(view.volume(r[kept]))
        echoing = np.isfinite(level)
        return local[kept][echoing], size[echoing]

    def _surface(self, view: View, to_image: Array, power: Array, diffuse: bool) -> tuple[Array, ...]:
        """Brighter the squarer the beam meets the surface, undeformed; and where they scatter, from all sides.

        Places, amplitudes, normals, and amplitudes of the mirror and of what is scattered.
        """
        points_per_mm2, gain, width, faintest = self.numbers[3:]
        copies = interface_copies(self.spacing, points_per_mm2)
        used = int(np.clip(np.ceil(view.points_per_mm2 * largest_face(self.spacing)), 1, copies))
        by_face = (part.reshape(-1, copies, *part.shape[1:])[:, :used] for part in self._interfaces)
        found = Points(*(part.reshape(-1, *part.shape[2:]) for part in by_face))
        if diffuse:
            found = layered(found, self.impedance, self.wall_mm, self.wall_impedance, self.numbers[2])
        mirror = gain * points_per_mm2 * copies / used * found.reflection.astype(np.float64) * found.area
        seen = _mapped(to_image, found.points.astype(np.float64))
        r = view.ranges(seen)
        kept = np.flatnonzero(view.hears(seen, r, view.margin_mm))
        normal, r, mirror = found.normals[kept] @ to_image[:, :3].T, r[kept], mirror[kept]
        along = normal[:, 1]
        if view.curved:
            from_apex = seen[kept, :2] + [0, view.apex_mm]
            along = (normal[:, :2] * from_apex).sum(axis=1) / np.maximum(r + view.apex_mm, 1e-9)
        size = mirror * np.exp(-width * (1 - along**2))
        scatter = np.zeros(len(size))
        if diffuse:
            beam = view.lateral_mm * view.volume(r) / view.cell_mm2
            part = Points(*(p[kept] for p in found))
            scatter = mirror * scattered(part, self.rough, beam * used / copies)
        audible = size + np.abs(scatter) > view.faintest * faintest
        if diffuse:
            rises = self.impedance[found.labels[kept, 0]] < self.impedance[found.labels[kept, 1]]
            low, high = self.opaque[found.labels[kept]].T
            audible &= np.where(rises == (along > 0), low <= high, high <= low)
        speckle = np.sqrt(np.interp(r[audible] / view.sample_mm, np.arange(len(power)), power))
        at = kept[audible]
        size, mirror, scatter = (part[audible] * speckle for part in (size + scatter, mirror, scatter))
        return found.points[at].astype(np.float64), size, found.normals[at].astype(np.float64), mirror, scatter

    def _bricks(self, view: View, to_image: Array) -> NDArray[np.int64]:
        """Indices (n, 3) of bricks of the lattice that a slice touches."""
        away = max(abs(view.focus_mm), abs(view.depth_mm - view.focus_mm))
        thick = view.cut * np.hypot(view.elevation_mm, view.spread * away)
        wide = (view.depth_mm + view.apex_mm) * np.sin(view.half_angle) if view.curved else view.half_width_mm
        top = view.apex_mm * (np.cos(view.half_angle) - 1)
        box = np.array([[-wide, wide], [top, view.depth_mm], [-thick, thick]])
        box += (view.margin_mm + view.beside_mm) * np.array([-1, 1])
        corners = np.stack(np.meshgrid(*box, indexing="ij"), axis=-1).reshape(-1, 3)
        local = (corners - to_image[:, 3]) @ to_image[:, :3]
        half = self.spacing / 2
        end = (np.array(self.labels.shape) - 1) * self.spacing + half
        first = np.floor(np.maximum(local.min(axis=0), -half) / view.brick_mm)
        last = np.ceil(np.minimum(local.max(axis=0), end) / view.brick_mm)
        fits = max(np.abs(first).max(), np.abs(last).max()) < MOST_NODES
        require(fits, "brick_mm is too small for the scene")
        low, high = first.astype(np.int64), last.astype(np.int64)
        found = [np.zeros((0, 3), np.int64)]
        for i in range(low[0], high[0]) if (high > low).all() else ():  # an oblique slice fills little of its box
            layer = np.stack(np.meshgrid([i], *(np.arange(low[a], high[a]) for a in (1, 2)), indexing="ij"), axis=-1)
            layer = layer.reshape(-1, 3)
            seen = _mapped(to_image, (layer + 0.5) * view.brick_mm)
            found.append(layer[view.hears(seen, view.ranges(seen), view.margin_mm + view.brick_mm)])
        return np.concatenate(found)

    def _level_db(self, local: NDArray[np.floating], key: Words) -> Array:
        """Backscatter at positions (m, 3) in the lattice's coordinates; -inf where nothing echoes."""
        from scipy.ndimage import map_coordinates

        shape = np.array(self.labels.shape)
        # nearest voxel of a place off by up to half a voxel: a finer probe would show the voxels
        bits = key * np.uint64(0x9E3779B97F4A7C15)
        bits = (bits ^ (bits >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
        off = ((bits[:, None] >> np.array([16, 32, 48], np.uint64)) & np.uint64(0xFFFF)) / 65536.0
        index = np.floor(local / self.spacing + off).astype(np.int64)
        inside = ((index >= 0) & (index < shape)).all(axis=1)
        labels = self.labels[tuple(np.clip(index, 0, shape - 1).T)]
        level = np.where(inside & (self.level_db > self.no_echo)[labels], self.level_db[labels], -np.inf)
        varies = np.flatnonzero((self.texture_db[labels] > 0) & inside)
        kinds = self.texture_kind[labels[varies]].astype(int)
        for kind in np.unique(kinds):
            of = varies[kinds == kind]
            place = np.einsum("mab,mb->am", self.texture_map[labels[of]], local[of])
            noise = map_coordinates(self.texture[kind], place, output=np.float64, order=1, mode="grid-wrap")
            level[of] += self.texture_db[labels[of]] * noise
        return level


def _mapped(affine: Array, points: NDArray[np.floating]) -> Array:
    return points @ affine[:, :3].T + affine[:, 3]


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


def _frames(view: View, cells: NDArray[np.int64], cell_to_image: Array, spacing: Array) -> Array:
    """Rotation to lateral, elevation and axial, and where the first corner lies in the beam (cells, 16)."""
    x, y, z = _mapped(cell_to_image, cells.astype(np.float64)).T
    angle = np.arctan2(x, y + view.apex_mm) if view.curved else np.zeros(len(cells))
    r = np.hypot(x, y + view.apex_mm) - view.apex_mm if view.curved else y
    line = (angle if view.curved else x) / view.line_step + (view.lines - 1) / 2
    cos, sin, zero, one = np.cos(angle), np.sin(angle), np.zeros(len(cells)), np.ones(len(cells))
    # rows: lateral, elevation, axial in image coordinates (x right, y deep, z out of the plane)
    local = np.stack([cos, -sin, zero, zero, zero, one, sin, cos, zero], axis=1).reshape(-1, 3, 3)
    rotation = (local @ (cell_to_image[:, :3] / spacing)).reshape(-1, 9)
    cycles = r * view.cycles_per_mm
    return np.column_stack([rotation, r, line, cycles - np.rint(cycles), r + view.apex_mm, z, zero, zero])


def _nodes(cells: NDArray[np.int64], shape: tuple[int, int, int]) -> NDArray[np.int32]:
    last = np.array(shape) - 1
    low, high = np.clip(cells, 0, last), np.clip(cells + 1, 0, last)
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    return np.column_stack([low @ strides, (high - low) * strides]).astype(np.int32)


def _hash(bricks: NDArray[np.int64], seed: int) -> Words:
    """A 64-bit hash of each brick's index (splitmix64 finaliser)."""
    x = np.full(len(bricks), (seed + 1) & 0xFFFFFFFF, np.uint64)
    with np.errstate(over="ignore"):
        for axis in range(3):
            x ^= bricks[:, axis].astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15) + (x << np.uint64(6))
            x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            x ^= x >> np.uint64(31)
    return x

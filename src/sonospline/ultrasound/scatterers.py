"""Scatterers in material coordinates: where they are, and how strongly they echo.

They fill bricks of tissue. A brick takes a prefix of one of a few shared Sobol patterns, mirrored, by a
hash of its position: the same tissue always holds the same scatterers. How long a prefix follows from the
brick's undeformed depth, so that a resolution cell holds as many near the probe as far from it. Sobol
order and independent random signs make 8 in a cell enough for fully developed speckle. Random places alone
would let intensities vary too much, even ones alone 7 % too little: one scatterer in ten goes astray.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import pose
from .acoustics import NO_ECHO
from .interfaces import POINTS_PER_MM2
from .optics import ELEVATION_CUT, Optics
from .scene import Scene

Array = NDArray[np.float64]
Words = NDArray[np.uint64]

_PATTERNS = 64
_LONGEST = 512
_ASTRAY = 0.1
"""Share of scatterers at random places."""
_PER_BRICK = 48
"""Scatterers in a brick where they are densest."""
_INTERFACE_GAIN = 6.5
_INTERFACE_WIDTH = 7.0
"""Interface echo over speckle: R g exp(-7 sin^2 theta) for each of six points a mm^2."""


class Scatterers(NamedTuple):
    """Undeformed places and amplitudes."""

    points: Array
    """(m, 3) world positions."""
    amplitude: Array
    """(m,) signed, so that liver speckle has power ``Optics.speckle_power``."""


def volume_scatterers(scene: Scene, optics: Optics, transform: Array, margin_mm: float, seed: int) -> Scatterers:
    """Return the scatterers within a probe's slice and ``margin_mm`` around it."""
    probe = optics.probe
    finest = float(optics.density(np.linspace(0, probe.depth_mm, 200)).max())
    side = (_PER_BRICK / finest) ** (1 / 3)
    bricks = _bricks(scene, optics, transform, margin_mm, side)
    if not len(bricks):
        return Scatterers(np.zeros((0, 3)), np.zeros(0))
    centres = scene.labels.lattice.world((bricks + 0.5) * side)
    depth = probe.beam_coordinates(pose.to_image(transform, centres))[:, 0]
    wanted = optics.density(depth) * side**3
    key = _hash(bricks, seed)
    count = np.minimum(np.floor(wanted + _unit(key >> np.uint64(40), 24)), _LONGEST).astype(np.int64)
    brick = np.repeat(np.arange(len(bricks)), count)
    number = np.arange(len(brick)) - np.repeat(np.cumsum(count) - count, count)
    patterns, signs = _patterns()
    bits = key[brick]
    place = patterns[(bits & np.uint64(_PATTERNS - 1)).astype(np.int64), number]
    mirrored = ((bits[:, None] >> np.array([6, 7, 8], np.uint64)) & np.uint64(1)).astype(bool)
    place = np.where(mirrored, 1 - place, place)
    sign = signs[((bits >> np.uint64(9)) & np.uint64(_PATTERNS - 1)).astype(np.int64), number]
    local = (bricks[brick] + place) * side
    points = scene.labels.lattice.world(local)
    kept = _heard(probe_points := pose.to_image(transform, points), optics, margin_mm)
    local, points, sign = local[kept], points[kept], sign[kept]
    level = _level_db(scene, local, seed)
    density = optics.density(probe.beam_coordinates(probe_points[kept])[:, 0])
    amplitude = sign * 10 ** (level / 20) / np.sqrt(density)
    echoing = level > NO_ECHO
    return Scatterers(points[echoing], amplitude[echoing])


def interface_scatterers(scene: Scene, optics: Optics, transform: Array, margin_mm: float) -> Scatterers:
    """Return the surfaces' points within a slice, brighter the squarer the beam meets them, undeformed."""
    interfaces = scene.interfaces(*_box(scene, optics, transform, margin_mm))
    seen = pose.to_image(transform, interfaces.points.astype(np.float64))
    kept = np.flatnonzero(_heard(seen, optics, margin_mm))
    normal = interfaces.normals[kept] @ transform[:3, :3]
    beam = beam_directions(optics, seen[kept])
    square = 1 - (normal * beam).sum(axis=1) ** 2
    r = optics.probe.beam_coordinates(seen[kept])[:, 0]
    strength = _INTERFACE_GAIN * interfaces.reflection[kept] * np.exp(-_INTERFACE_WIDTH * square)
    strength *= interfaces.area[kept] * POINTS_PER_MM2 * np.sqrt(optics.power_at(r))
    audible = strength > 0.02 * np.sqrt(optics.power_at(r))
    return Scatterers(interfaces.points[kept][audible].astype(np.float64), strength[audible])


def beam_directions(optics: Optics, points: Array) -> Array:
    """Return unit vectors (m, 3) of the beams through image points (m, 3)."""
    probe = optics.probe
    if not probe.curved:
        return np.broadcast_to([0.0, 1.0, 0.0], points.shape)
    from_apex = points * [1, 1, 0] + [0, probe.apex_mm, 0]
    return from_apex / np.maximum(np.linalg.norm(from_apex, axis=1, keepdims=True), 1e-9)


def _heard(points: Array, optics: Optics, margin_mm: float, more_mm: float = 0.0) -> NDArray[np.bool_]:
    """Which image points may reach a beam once displaced by at most ``margin_mm``."""
    probe, slack = optics.probe, margin_mm + more_mm
    r, line, z = probe.beam_coordinates(points).T
    beside = slack / np.maximum(probe.line_spacing(np.maximum(r, 1.0)), 0.02) + 3
    near = (r > -slack - 1) & (r < probe.depth_mm + slack + 1)
    near &= (line > -beside) & (line < probe.lines - 1 + beside)
    away = np.minimum(np.abs(r - probe.elevation_focus_mm) + slack, 2 * probe.depth_mm)
    sigma = np.hypot(probe.elevation_sigma(probe.elevation_focus_mm), probe.elevation_spread * away)
    return near & (np.abs(z) < ELEVATION_CUT * sigma + slack)


def _box(scene: Scene, optics: Optics, transform: Array, margin_mm: float) -> tuple[Array, Array]:
    """Corners of the box around a slice, in the scene's lattice frame."""
    left, right, top, bottom = optics.probe.footprint
    thick = ELEVATION_CUT * float(optics.probe.elevation_sigma(np.array([0, optics.probe.depth_mm])).max()) + margin_mm
    box = np.array([[left, right], [top, bottom], [-thick, thick]])
    box[:2] += np.array([-margin_mm, margin_mm])
    corners = np.stack(np.meshgrid(*box, indexing="ij"), axis=-1).reshape(-1, 3)
    local = scene.labels.lattice.local(pose.to_reference(transform, corners))
    return local.min(axis=0), local.max(axis=0)


def _bricks(scene: Scene, optics: Optics, transform: Array, margin_mm: float, side: float) -> NDArray[np.int64]:
    """Indices (n, 3) of bricks of the scene's lattice frame that a slice touches."""
    box = _box(scene, optics, transform, margin_mm)
    half = np.array(scene.labels.lattice.spacing) / 2
    low = np.floor(np.maximum(box[0], -half) / side).astype(np.int64)
    high = np.ceil(np.minimum(box[1], scene.labels.lattice.extent + half) / side).astype(np.int64)
    if (high <= low).any():
        return np.zeros((0, 3), np.int64)
    found = []
    for i in range(low[0], high[0]):  # a layer at a time: an oblique slice fills little of its box
        layer = np.stack(
            np.meshgrid([i], np.arange(low[1], high[1]), np.arange(low[2], high[2]), indexing="ij"), axis=-1
        )
        layer = layer.reshape(-1, 3)
        centres = pose.to_image(transform, scene.labels.lattice.world((layer + 0.5) * side))
        found.append(layer[_heard(centres, optics, margin_mm, side)])
    return np.concatenate(found)


def _level_db(scene: Scene, local: Array, seed: int) -> Array:
    """Backscatter at positions (m, 3) of the scene's lattice frame; NO_ECHO beyond it."""
    spacing, shape = np.array(scene.labels.lattice.spacing), np.array(scene.bytes.shape)
    random = np.random.default_rng(seed + 1)
    # nearest voxel of a place off by up to half a voxel: a finer probe would show the voxels
    dithered = local / spacing + random.uniform(-0.5, 0.5, local.shape)
    index = np.floor(dithered + 0.5).astype(np.int64)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    labels = scene.bytes[tuple(np.clip(index, 0, shape - 1).T)]
    level = np.where(inside, scene.table("backscatter_db")[labels], NO_ECHO)
    noise = _texture()
    for label, tissue in scene.tissues.items():
        if tissue.texture_db > 0:
            chosen = np.flatnonzero((labels == label) & inside)
            place = local[chosen] / (np.array(tissue.texture_mm) / _TEXTURE_VOXELS)
            level[chosen] += tissue.texture_db * _periodic(noise, place)
    return level


_TEXTURE_VOXELS = 3.0


@lru_cache(maxsize=1)
def _texture() -> NDArray[np.float32]:
    """A periodic random volume of mean 0 and standard deviation 1, smooth over three voxels."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(np.random.default_rng(7).standard_normal((56, 56, 56)).astype(np.float32), 1.3, mode="wrap")
    return (noise - noise.mean()) / noise.std()


def _periodic(volume: NDArray[np.float32], index: Array) -> Array:
    from scipy.ndimage import map_coordinates

    return map_coordinates(volume, index.T, order=1, mode="grid-wrap")


@lru_cache(maxsize=1)
def _patterns() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Places in a unit brick (patterns, n, 3), in an order whose every prefix is even, and signs (patterns, n)."""
    random = np.random.default_rng(11)
    shifts = random.integers(0, 2**_SOBOL_BITS, (_PATTERNS, 1, 3), dtype=np.uint32)
    places = ((_sobol(_LONGEST) ^ shifts) + 0.5) / 2**_SOBOL_BITS
    astray = random.random((_PATTERNS, _LONGEST)) < _ASTRAY
    places[astray] = random.random((int(astray.sum()), 3))
    return places.astype(np.float32), random.choice(np.array([-1, 1], np.float32), (_PATTERNS, _LONGEST))


_SOBOL_BITS = 24


def _sobol(count: int) -> NDArray[np.uint32]:
    """The first points of the 3-D Sobol sequence as integers (count, 3), by the direction numbers of Joe and Kuo."""
    # SciPy has it in scipy.stats.qmc, whose import takes seconds
    points = np.zeros((count, 3), np.uint32)
    for axis, (start, coefficients) in enumerate((((1,), None), ((1,), ()), ((1, 3), (1,)))):
        directions = [m << (_SOBOL_BITS - 1 - k) for k, m in enumerate(start)]
        while len(directions) < _SOBOL_BITS:
            if coefficients is None:  # van der Corput's sequence
                directions.append(directions[-1] >> 1)
                continue
            degree = len(start)
            value = directions[-degree] ^ (directions[-degree] >> degree)
            for k, coefficient in enumerate(coefficients, start=1):
                value ^= coefficient * directions[-k]
            directions.append(value)
        for bit, direction in enumerate(directions[: count.bit_length()]):
            points[:, axis] ^= np.where(np.arange(count) >> bit & 1, direction, 0).astype(np.uint32)
    return points


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


def _unit(words: Words, bits: int) -> Array:
    return words.astype(np.float64) / 2**bits

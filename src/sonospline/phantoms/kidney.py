"""A kidney-access phantom: flank, rib, kidney with its collecting system, and targets in calyces.

Axes in mm: x from head to foot, y across the image, z from the skin down. Sizes: kidney 106 x 48 x 46 mm and
134 ml (length 106 +- 7, width 48 +- 8: PLoS ONE 2019 e0224785); parenchyma 15 to 20, with 6 of cortex over
the pyramids; 15 pyramids in three rows (9 to 14 are usual, of which an image cuts a few); skin to calyx about
110 along the needle (prone 98, 65 to 129: R J Urol 2016;195:377). The rest was set by eye.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._cache import digest, keep, place, recall
from ..geometry import pose
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.volume import Volume
from ..ultrasound.flow import Flow
from ..ultrasound.phantom import Phantom
from .canvas import Array, Canvas
from .canvas import __file__ as canvas_file

LABELS = {
    0: "gel", 1: "skin", 2: "fat", 3: "muscle", 4: "fascia", 5: "bone", 6: "perirenal fat", 7: "kidney cortex",
    8: "kidney medulla", 9: "sinus fat", 10: "urine", 11: "blood", 12: "vessel wall",
}  # fmt: skip
LOW_MM, HIGH_MM = (-40.0, 0.0, 0.0), (200.0, 100.0, 130.0)
"""Corners of the acoustic phantom: wider than the mechanical box."""
BOX_MM = (180.0, 100.0, 120.0)
"""The mechanical box: wide enough for an oblique entry through the skin of the flank."""

Point = tuple[float, float, float]

_GEL, _SKIN, _FAT, _MUSCLE, _FASCIA, _BONE, _PERIRENAL, _CORTEX, _MEDULLA, _SINUS, _URINE, _BLOOD, _WALL = range(13)
_PROBE_X, _PROBE_Y, _PUSH = 58.0, 50.0, 8.0
_CENTRE = np.array([62.0, 50.0, 72.0])
_SEMI_AXES = np.array([53.0, 24.0, 23.0])
_EXPONENT = 2.2
_TILT = np.radians(10.0)
_CORTEX_MM = 6.0
_CALYX = (24.0, 0.0, 3.0)
_VESSELS = (
    ((3.0, -9.0, 34.0), (5.0, -6.0, 16.0), (3.4, 2.6)), ((5.0, -6.0, 16.0), (17.0, -3.0, 7.0), (2.4, 1.5)),
    ((5.0, -6.0, 16.0), (-14.0, -2.5, 7.5), (2.4, 1.5)), ((-6.0, 6.0, 34.0), (-5.0, 5.0, 14.0), (3.0, 2.2)),
)  # fmt: skip
"""Artery, its two branches, and vein: ends outside the kidney and in it, and radii there."""
_ARTERY_CM_S, _BRANCH_CM_S, _VEIN_CM_S = 50.0, 40.0, 30.0
"""In the middle of each, where it begins."""
_BRANCH_FROM = 0.72
"""Share of a branch's way that lies in the cortex, or nearly."""
_STATIONS = (-33.0, -21.0, -8.0, 8.0, 33.0)
_ROWS_DEG = (-62.0, 0.0, 62.0)


@dataclass(frozen=True, eq=False)
class KidneyPhantom:
    """The phantom, where to look from, and where to go."""

    phantom: Phantom
    targets: dict[str, NDArray[np.float64]]
    """Calyces by name: world positions of their middles."""

    @property
    def probe_to_reference(self) -> NDArray[np.float64]:
        """``ProbeToReference`` of a probe pressed onto the flank, its plane along the kidney."""
        return pose.facing((_PROBE_X, _PROBE_Y, _PUSH), depth=(0, 0, 1), right=(1, 0, 0))

    @property
    def needle(self) -> Needle:
        """A needle in the image plane, from the skin of the flank into the lower calyx, at 40 degrees to the skin."""
        target = self.targets["lower calyx"]
        direction = np.array([-np.cos(np.radians(40)), 0.0, np.sin(np.radians(40))])
        length = (target[2] - 1.0) / direction[2]
        return Needle(target - length * direction, target)

    def grid(self, nodes: int = 150_000) -> Grid:
        """Return the mechanical box's grid; the needle enters through its face ``z-``, the skin."""
        return Grid.covering(BOX_MM, nodes=nodes)

    def __repr__(self) -> str:
        return f"KidneyPhantom({self.phantom!r}, {', '.join(self.targets)})"


def kidney_phantom(*, spacing_mm: float = 0.5, pressed: bool = True, kept: bool = False) -> KidneyPhantom:
    """Return the phantom.

    Parameters
    ----------
    spacing_mm : float, default: 0.5
        Voxel size of the label map.
    pressed : bool, default: True
        Whether a convex face of 60 mm radius is pressed 8 mm into the skin at x = 58, y = 50.
    kept : bool, default: False
        Whether to take the label map from the cache folder where it was made before, and to
        keep it there: 26 MB at the default spacing, and a second or two saved.

    Examples
    --------
    >>> from sonospline.phantoms import kidney_phantom
    >>> phantom = kidney_phantom(spacing_mm=2.0)
    >>> sorted(phantom.targets)
    ['lower calyx', 'pelvis', 'upper calyx']
    """
    if _validate.number("spacing_mm", spacing_mm, positive=True) > 4:
        raise ValueError(f"spacing_mm = {spacing_mm} is too coarse for a kidney; give at most 4")
    volume = painted(Canvas(LOW_MM, HIGH_MM, spacing_mm), partial(paint, pressed=pressed), (pressed,) if kept else None)
    return KidneyPhantom(Phantom(volume, LABELS, flows=flows()), targets())


def targets() -> dict[str, NDArray[np.float64]]:
    """Return the middles of calyces and pelvis, world."""
    return {
        "lower calyx": world((*_CALYX[:2], _CALYX[2] + 1.0)),
        "upper calyx": world((-25.0, 0.0, 3.0)),
        "pelvis": world((0.0, 0.0, 14.0)),
    }


def painted(canvas: Canvas, paint: Callable[[Canvas], None], kept_by: tuple[object, ...] | None) -> Volume:
    """Return what is painted; where it is kept, from the cache, by what makes it another."""
    if kept_by is None:
        paint(canvas)
    else:
        file = _kept_file(canvas, kept_by)
        known = recall(file, partial(_read_labels, shape=canvas.labels.shape), "the kidney phantom")
        if known is None:
            paint(canvas)
            keep(file, lambda stream: np.save(stream, canvas.labels), "the kidney phantom")
        else:
            canvas.labels = known
    return Volume(voxels=canvas.labels, spacing=(canvas.spacing_mm,) * 3, origin=canvas.origin)


def paint(canvas: Canvas, *, pressed: bool) -> None:
    """Paint flank, rib and kidney; all that lies wider repeats what is there."""
    _paint_flank(canvas, _PUSH if pressed else 0.0)
    _paint_rib(canvas)
    _paint_kidney(canvas)
    _paint_sinus(canvas)


def _kept_file(canvas: Canvas, by: tuple[object, ...]) -> Path | None:
    """A name that changes with what is painted: with this file and the one of the canvas."""
    painter = [Path(source).read_bytes() for source in (__file__, canvas_file)]
    return place(f"kidney-{digest(canvas.spacing_mm, canvas.origin.tolist(), canvas.labels.shape, by, painter)}.npy")


def _read_labels(stream: IO[bytes], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    labels = np.load(stream, allow_pickle=False)
    if labels.shape != shape or labels.dtype != np.uint8:
        raise ValueError(f"it holds {labels.dtype} {labels.shape} instead of bytes {shape}")
    return labels


def world(local: tuple[float, ...]) -> NDArray[np.float64]:
    """A position of the kidney's frame (x towards its lower pole, z towards its hilum) in the world."""
    x, y, z = local
    return _CENTRE + np.array([np.cos(_TILT) * x + np.sin(_TILT) * z, y, -np.sin(_TILT) * x + np.cos(_TILT) * z])


def flows() -> list[Flow]:
    """Return what flows through hilum and sinus: in through the artery and its branches, out through the vein."""
    artery, *branches, (out, inner, (wide, narrow)) = _VESSELS
    courses = [(*artery, _ARTERY_CM_S), *((*_beyond_cortex(*branch), _BRANCH_CM_S) for branch in branches)]
    courses.append((inner, out, (narrow, wide), _VEIN_CM_S))
    return [
        Flow(start=_point(start), end=_point(end), radii_mm=radii, speed_cm_s=speed)
        for start, end, radii, speed in courses
    ]


def _beyond_cortex(start: Point, end: Point, radii: tuple[float, float]) -> tuple[Point, Point, tuple[float, float]]:
    """A branch of the artery from where it has left the cortex, which no vessel is painted over."""
    x, y, z = (a + _BRANCH_FROM * (b - a) for a, b in zip(start, end, strict=True))
    return (x, y, z), end, (radii[0] + _BRANCH_FROM * (radii[1] - radii[0]), radii[1])


def _point(local: Point) -> Point:
    x, y, z = world(local).tolist()
    return x, y, z


def _local(x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    dx, dz = x - _CENTRE[0], z - _CENTRE[2]
    return np.cos(_TILT) * dx - np.sin(_TILT) * dz, y - _CENTRE[1], np.sin(_TILT) * dx + np.cos(_TILT) * dz


def _paint_flank(canvas: Canvas, push: float) -> None:
    """Skin, fat with septa, muscle with fascia, perirenal fat and psoas, as the pressed probe leaves them."""
    x, y, _ = canvas.axes()
    sag = 60 - np.sqrt(np.maximum(60**2 - (x - _PROBE_X) ** 2, 0))
    contact = np.maximum(push - sag, 0) * np.exp(-(((y - _PROBE_Y) / 16) ** 4) / 2)

    def surface(depth: Array) -> NDArray[np.int64]:
        """First voxel of each column below a surface that lies at ``depth`` where nothing presses."""
        now = depth + contact * np.exp(-np.maximum(depth, 0) / 30)
        return np.ceil(now[..., 0] / canvas.spacing_mm).astype(np.int64)

    def wave(amplitude: float, period: float, phase: float) -> Array:
        return amplitude * np.sin(2 * np.pi * (x + 0.35 * y) / period + phase) + 0 * y

    fat_end = 13 + wave(0.9, 47, 0.3)
    muscle_end = 31 + 3 * np.sin(np.pi * x / 120) + wave(1.0, 38, 1.1)
    psoas = 101 + wave(2.0, 90, 0.5) + 0.00035 * (x - 70) ** 2
    layers = [
        (0 * x + 0 * y, _SKIN), (2 + wave(0.15, 23, 0), _FAT), (fat_end, _FASCIA), (fat_end + 0.7, _MUSCLE),
        (muscle_end, _FASCIA), (muscle_end + 0.7, _PERIRENAL), (psoas, _FASCIA), (psoas + 0.8, _MUSCLE),
    ]  # fmt: skip
    _pile(canvas.labels, np.stack([surface(start) for start, _ in layers]), [label for _, label in layers])
    sheets = [(4 + 1.8 * k + wave(0.5, 31 + 9 * k, k), 0.5, _FAT, 0.1 + 0.15 * k) for k in range(5)]
    sheets += [(18.5 + wave(0.8, 61, 2.0), 0.6, _MUSCLE, -0.7), (24.5 + wave(0.9, 53, 0.9), 0.6, _MUSCLE, -0.5)]
    sheets += [(21.5 + wave(0.6, 29, 0.2), 0.5, _MUSCLE, 0.4), (28 + wave(0.6, 33, 2.2), 0.5, _MUSCLE, 0.4)]
    for number, (start, thickness, inside, broken) in enumerate(sheets):
        first, last = surface(start), surface(start + thickness)
        last = np.maximum(last, first + 1)
        there = (np.sin(2 * np.pi * x / (19 + 5 * number) + number) + np.sin(2 * np.pi * y / 23 + 2 * number))[
            ..., 0
        ] > broken
        rows, columns = np.nonzero(there)
        for step in range(int((last - first).max())):
            level = np.minimum(first + step, canvas.labels.shape[2] - 1)
            chosen = (first + step < last)[rows, columns]
            i, j = rows[chosen], columns[chosen]
            k = level[i, j]
            same = canvas.labels[i, j, k] == inside
            canvas.labels[i[same], j[same], k[same]] = _FASCIA


def _pile(labels: NDArray[np.uint8], starts: NDArray[np.int64], layers: list[int]) -> None:
    """Fill columns with layers from their first voxels (layers, nx, ny) on; where they cross, the later one shows."""
    starts = np.minimum.accumulate(starts[::-1], axis=0)[::-1]
    rows, columns = np.ogrid[: labels.shape[0], : labels.shape[1]]
    above = 0
    for start, label in zip(starts, layers, strict=True):
        within = (start >= 0) & (start < labels.shape[2])
        at = rows, columns, np.where(within, start, 0)
        labels[at] += np.where(within, label - above, 0).astype(np.uint8)
        above = label
    np.cumsum(labels, axis=2, dtype=np.uint8, out=labels)


def _paint_rib(canvas: Canvas) -> None:
    """The twelfth rib, crossing the image near its cranial edge."""

    def inside(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        return ((x - 27 - 0.1 * (y - 50)) / 6.5) ** 2 + ((z - 23) / 4.2) ** 2 < 1

    end = canvas.origin + canvas.spacing_mm * np.array(canvas.labels.shape)
    canvas.paint(_BONE, (-10, canvas.origin[1], 18), (65, end[1], 28), inside)


def level_at(x: Array, y: Array, z: Array) -> Array:
    """A function of place that is the same on surfaces alike to the kidney's (a superellipsoid)."""
    local = _local(x, y, z)
    powers = [np.abs(c / a) ** _EXPONENT for c, a in zip(local, _SEMI_AXES.tolist(), strict=True)]
    return powers[0] + powers[2] + powers[1]  # those of x and z first: they are one sheet


def level_of(radius: float) -> float:
    """Its value on the surface so many times as large as the kidney's."""
    return float(radius**_EXPONENT)


def _paint_kidney(canvas: Canvas) -> None:
    """Gerota's fascia, capsule, cortex, pyramids, and the notch of the hilum."""
    reach = np.array([66, 36, 40])
    low, high = _CENTRE - reach, _CENTRE + reach

    def gerota(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        level = level_at(x, y, z)
        between = (level > level_of(1 + 7.2 / 24)) & (level < level_of(1 + 7.9 / 24))
        return between & (np.sin(x / 7) + np.sin(y / 5) > -0.6)

    canvas.paint(_FASCIA, low, high, gerota, over=(_PERIRENAL,))
    canvas.paint(_FASCIA, low, high, lambda x, y, z: level_at(x, y, z) < 1)
    canvas.paint(_CORTEX, low, high, lambda x, y, z: level_at(x, y, z) < level_of(1 - 0.6 / 24))
    for station in _STATIONS:
        for row in _ROWS_DEG:
            paint_pyramid(canvas, station, row)
    notch = world((0.0, 0.0, 25.0))

    def hilum(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        u, v, w = _local(x, y, z)
        return (u / 13) ** 2 + (v / 11) ** 2 + ((w - 25) / 13) ** 2 < 1

    canvas.paint(_SINUS, notch - 15, notch + 15, hilum, over=(_CORTEX, _MEDULLA, _FASCIA))


def paint_pyramid(canvas: Canvas, station: float, row_deg: float) -> None:
    """Paint a cone with its apex on the sinus and its base under the cortex; those near the poles lean outward.

    Its station is along the kidney; its row turns about it: 0 points to the flank, 180 to the side of the hilum.
    """
    lean, row = np.radians(0.9 * station), np.radians(row_deg)
    axis = np.array([np.sin(lean), np.cos(lean) * np.sin(row), -np.cos(lean) * np.cos(row)])
    apex = np.array([0.8 * station, 8.5 * np.sin(row), 2 - 6.5 * np.cos(row)])
    middle = world(tuple(apex + 9 * axis))

    def inside(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        offset = [c - a for c, a in zip(_local(x, y, z), apex, strict=True)]
        height = sum(o * a for o, a in zip(offset, axis, strict=True))
        across = np.sqrt(np.maximum(sum(o * o for o in offset) - height**2, 0))
        wide = np.minimum(2.2 + 0.42 * height, 5.0)
        return (height > 0) & (height < 17) & (across < wide) & (level_at(x, y, z) < level_of(1 - _CORTEX_MM / 23))

    canvas.paint(_MEDULLA, middle - 20, middle + 20, inside, over=(_CORTEX,))


def _paint_sinus(canvas: Canvas) -> None:
    """Sinus fat, the collecting system in it, and the vessels of the hilum."""
    centre = world((0.0, 0.0, 2.0))

    def sinus(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        u, v, w = _local(x, y, z)
        angle = np.arctan2(w - 2, u)
        wobble = 1 + 0.07 * np.sin(5 * angle + 0.4) + 0.05 * np.sin(9 * angle + v / 3)
        return (u / 32) ** 2 + (v / 10.5) ** 2 + ((w - 2) / 8.5) ** 2 < wobble**2

    reach = np.array([40, 14, 22])
    canvas.paint(_SINUS, centre - reach, centre + reach, sinus, over=(_CORTEX, _MEDULLA))
    for start, end, radii in _VESSELS:
        canvas.tube(_WALL, world(start), world(end), (radii[0] + 0.6, radii[1] + 0.6), over=(_SINUS, _PERIRENAL))
        canvas.tube(_BLOOD, world(start), world(end), radii, over=(_WALL, _SINUS, _PERIRENAL))
    ducts = [
        ((0, 0, 24), (0, 0, 6), (4.5, 3.0)), ((0, 0, 8), (18, 0, 4), (2.4, 1.4)), ((0, 0, 8), (-25, 0, 3), (2.6, 1.4)),
        ((0, 0, 6), (0, 0, -2), (1.8, 1.4)), ((-25, 0, 3), (-29, 0, 1), (1.5, 2.3)),
        ((0, 0, -2), (1, 0, -5), (1.4, 2.0)), ((-13, 0, 5), (-12, 0, -4), (1.1, 1.9)),
        ((18, 0, 4), _CALYX, (1.6, 3.4)), (_CALYX, (26.0, 0.0, 3.5), (3.4, 4.4)),
    ]  # fmt: skip
    for begin, stop, ends in ducts:
        canvas.tube(_URINE, world(begin), world(stop), ends, over=(_SINUS, _CORTEX, _MEDULLA, _PERIRENAL))

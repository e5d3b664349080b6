"""The kidney with what lies around it, 200 mm wide: ribs and pleura, liver, colon, spine, and the ureter.

What a renal access has to miss: the colon beside the kidney, the lung above the twelfth rib, the liver at the upper
pole. Axes and kidney as in :mod:`~sonospline.phantoms.kidney`; the spine lies at small y. All of it was set by eye.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..ultrasound.phantom import Phantom
from . import kidney
from .canvas import Array, Canvas

LABELS = kidney.LABELS | {13: "liver", 14: "bowel wall", 15: "gassy bowel", 16: "aerated lung"}
LOW_MM, HIGH_MM = (-60.0, -50.0, 0.0), (210.0, 150.0, 130.0)

_MUSCLE, _FASCIA, _BONE, _PERIRENAL, _SINUS, _URINE = 3, 4, 5, 6, 9, 10
_LIVER, _BOWEL, _GAS, _LUNG = 13, 14, 15, 16
_LIVER_MM = ((-40.0, 85.0, 108.0), (78.0, 70.0, 50.0))
"""Middle and semi-axes."""
_COLON_MM, _COLON_WALL_MM = 14.0, 2.5
_DIAPHRAGM_MM = 3.0
_URETER = ((0.0, 0.0, 24.0), (16.0, -4.0, 26.5), (45.0, -10.0, 31.0), (150.0, -24.0, 49.0))
"""From the pelvis along the psoas, in the kidney's frame."""
_FAR_PYRAMIDS = ((-29.0, 180.0), (-16.0, 180.0), (16.0, 180.0), (29.0, 180.0))
"""Station and row of those on the side of the hilum, above and below it: medulla lies on both sides of the sinus."""


def wide_kidney_phantom(*, spacing_mm: float = 0.5, pressed: bool = True, kept: bool = False) -> kidney.KidneyPhantom:
    """Return the kidney with its neighbours, for probes that look across, too; the box of mechanics stays where it was.

    Parameters
    ----------
    spacing_mm : float, default: 0.5
        Voxel size.
    pressed : bool, default: True
        Whether a convex face is pressed into the skin, as in :func:`~sonospline.phantoms.kidney_phantom`.
    kept : bool, default: False
        Whether to take the label map from the cache folder where it was made before, and to keep it there: 56 MB at the
        default spacing.

    Raises
    ------
    ValueError
        A spacing that is too coarse for a kidney, or so fine that memory does not hold the scene.

    Examples
    --------
    >>> from sonospline.phantoms import wide_kidney_phantom
    >>> wide = wide_kidney_phantom(spacing_mm=4.0)
    >>> wide.phantom.tissues[13].name, wide.phantom.labels.lattice.extent.tolist()
    ('liver', [272.0, 200.0, 128.0])
    """
    if _validate.number("spacing_mm", spacing_mm, positive=True) > 4:
        raise ValueError(f"spacing_mm = {spacing_mm} is too coarse for a kidney; give at most 4")
    kept_by = ("wide", pressed, Path(__file__).read_bytes()) if kept else None
    volume = kidney.painted(Canvas(LOW_MM, HIGH_MM, spacing_mm), partial(_paint, pressed=pressed), kept_by)
    phantom = Phantom(volume, LABELS, flows=kidney.flows())
    return kidney.KidneyPhantom(phantom, kidney.targets())


def _paint(canvas: Canvas, *, pressed: bool) -> None:
    kidney.paint(canvas, pressed=pressed)
    for station, row_deg in _FAR_PYRAMIDS:
        kidney.paint_pyramid(canvas, station, row_deg)
    _paint_spine(canvas)
    _paint_liver(canvas)
    _paint_lung(canvas)
    _paint_colon(canvas)
    _paint_ribs(canvas)
    _paint_ureter(canvas)


def _paint_spine(canvas: Canvas) -> None:
    """Vertebral bodies and transverse processes, the muscle that covers them, and quadratus lumborum."""

    def muscle(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        return ((y + 28) / 46) ** 2 + ((z - 48) / 30) ** 2 + 0 * x < 1

    def sheath(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        return ((y + 28) / 46.8) ** 2 + ((z - 48) / 30.8) ** 2 + 0 * x < 1

    def body(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        between = np.abs((x + 8) % 34 - 17) < 13.5
        return between & (((y + 42) / 22) ** 2 + ((z - 82) / 18) ** 2 < 1)

    def process(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        along = np.abs((x + 8) % 34 - 17) / 4.5
        return (along**2 + ((z - 60 - 0.15 * (y + 42)) / 3.0) ** 2 < 1) & (y < -6)

    def disc(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        return ((y + 42) / 21) ** 2 + ((z - 82) / 17) ** 2 + 0 * x < 1

    whole = (LOW_MM[0], LOW_MM[1], 18.0), (HIGH_MM[0], 25.0, HIGH_MM[2])
    over = (_PERIRENAL, _MUSCLE)
    canvas.paint(_FASCIA, *whole, sheath, over=over)
    canvas.paint(_MUSCLE, *whole, muscle, over=(*over, _FASCIA))
    canvas.paint(_FASCIA, *whole, disc, over=over)
    canvas.paint(_BONE, *whole, body)
    canvas.paint(_BONE, *whole, process)


def _paint_liver(canvas: Canvas) -> None:
    middle, half = (np.array(sizes) for sizes in _LIVER_MM)

    def shape(grow: float, x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        away = [(c - m) / (h + grow) for c, m, h in zip((x, y, z), middle, half, strict=True)]
        beside = kidney.level_at(x, y, z) > kidney.level_of(1 + 9.0 / 24)  # the fat around the kidney stays
        return (away[0] ** 2 + away[1] ** 2 + away[2] ** 2 < 1) & beside

    low, high = middle - half - 1, middle + half + 1
    over = (_PERIRENAL, _MUSCLE, _FASCIA)
    canvas.paint(_FASCIA, low, high, partial(shape, 0.7), over=over)
    canvas.paint(_LIVER, low, high, partial(shape, 0.0), over=over)


def _paint_lung(canvas: Canvas) -> None:
    """The recess of the pleura behind the ribs, deeper towards the head, the diaphragm below it."""

    def wedge(thick: float, x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        edge = 8 + 0.12 * (y - 50)  # the costodiaphragmatic line, which falls towards the side
        inner = 33.2 + 3 * np.sin(np.pi * x / 120)
        return (x < edge + 0.6 * thick) & (z > inner) & (z < inner + 0.8 * (edge - x) + thick)

    low, high = (LOW_MM[0], -20.0, 24.0), (40.0, HIGH_MM[1], 110.0)
    over = (_PERIRENAL, _MUSCLE, _FASCIA, _LIVER)
    canvas.paint(_MUSCLE, low, high, partial(wedge, _DIAPHRAGM_MM), over=over)
    canvas.paint(_LUNG, low, high, partial(wedge, 0.0), over=over)


def _paint_colon(canvas: Canvas) -> None:
    """The ascending colon beside the kidney: a wall with haustra, and gas."""

    def tube(inward: float, x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
        radius = _COLON_MM * (1 + 0.13 * np.sin(x / 5.5)) - inward
        return ((y - 110 + 0.02 * x) / 1.3) ** 2 + (z - 70 - 0.05 * x) ** 2 < radius**2

    low, high = (25.0, 82.0, 45.0), (HIGH_MM[0], 135.0, 105.0)
    over = (_PERIRENAL, _FASCIA, _MUSCLE, _LIVER)
    canvas.paint(_BOWEL, low, high, partial(tube, 0.0), over=over)
    canvas.paint(_GAS, low, high, partial(tube, _COLON_WALL_MM), over=(_BOWEL,))


def _paint_ribs(canvas: Canvas) -> None:
    """The eleventh and the tenth, above the twelfth."""
    for number, (middle, slope) in enumerate(((-9.0, 0.14), (-44.0, 0.18))):

        def inside(x: Array, y: Array, z: Array, at: float = middle, by: float = slope) -> NDArray[np.bool_]:
            return ((x - at - by * (y - 50)) / 6.5) ** 2 + ((z - 23) / 4.2) ** 2 < 1

        canvas.paint(_BONE, (LOW_MM[0], LOW_MM[1], 18.0), (30.0 - 30 * number, HIGH_MM[1], 28.0), inside)


def _paint_ureter(canvas: Canvas) -> None:
    ends = [kidney.world(point) for point in _URETER]
    radii = (3.6, 2.4, 1.9, 1.7)
    for k, (start, end) in enumerate(pairwise(ends)):
        over = (_SINUS, _PERIRENAL, _MUSCLE, _FASCIA)
        canvas.tube(_URINE, start, end, (radii[k], radii[k + 1]), over=over)

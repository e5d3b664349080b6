"""The simulator's generated tissues: names of labels, where each is, and places to reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.volume import Volume
from ..ultrasound.acoustics import TISSUES, AcousticTissue
from ..ultrasound.flow import Flow
from ..ultrasound.phantom import Phantom
from .canvas import Canvas
from .kidney import BOX_MM, LABELS, KidneyPhantom, kidney_phantom
from .wide_kidney import LABELS as WIDE_LABELS
from .wide_kidney import wide_kidney_phantom

Array = NDArray[np.float64]

MECHANICAL_VOXEL_MM = 2.0
"""As fine as mechanics and surfaces need labels."""

_GEL_BLOCK_MM = (120.0, 60.0, 70.0)
_VESSEL = {"depth": 24.0, "radius": 3.5, "wall": 0.7, "slope": 0.12, "speed_cm_s": 40.0}
_CUBE_MM = 100.0
_SHEETS_MM, _SHEET_MM = 20.0, 0.6
_BESIDE_MM = 60.0
"""Of the cube's acoustic phantom beyond its pinned sides, where nothing moves: the fan is wider than the cube."""


@dataclass(frozen=True, eq=False)
class PaintedDent:
    """The dent of a probe that a phantom is painted with."""

    at: Array
    """(3,) the middle of the probe's face, world."""
    undented: Callable[[float], Phantom]
    """Makes the same phantom without it, of a voxel size."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GeneratedTissue:
    """A generated tissue."""

    phantom: Phantom
    names: dict[int, str]
    """Names of the labels, which materials and surfaces go by."""
    box: tuple[Array, Array]
    """Corners of the mechanical box."""
    targets: dict[str, Array]
    homogeneous: bool = False
    """Whether the labels are for the eye alone: one stiffness everywhere."""
    dent: PaintedDent | None = None


def kidney(voxel_mm: float) -> GeneratedTissue:
    """Return the kidney of :func:`~sonospline.phantoms.kidney_phantom`."""
    return _dented(kidney_phantom, LABELS, voxel_mm)


def wide_kidney(voxel_mm: float) -> GeneratedTissue:
    """Return the kidney of :func:`~sonospline.phantoms.wide_kidney_phantom`, in the same mechanical box."""
    return _dented(wide_kidney_phantom, WIDE_LABELS, voxel_mm)


def _dented(make: Callable[..., KidneyPhantom], names: dict[int, str], voxel_mm: float) -> GeneratedTissue:
    found = make(spacing_mm=voxel_mm, kept=True)
    return GeneratedTissue(
        phantom=found.phantom, names=names, box=(np.zeros(3), np.array(BOX_MM)), targets=found.targets,
        dent=PaintedDent(found.probe_to_reference[:3, 3], partial(_undented, make)),
    )  # fmt: skip


def _undented(make: Callable[..., KidneyPhantom], voxel_mm: float) -> Phantom:
    return make(spacing_mm=voxel_mm, pressed=False, kept=True).phantom


def gel_block(voxel_mm: float) -> GeneratedTissue:
    """Return a block of tissue-mimicking gel that a vessel crosses, a little aslant."""
    labels = Canvas((0, 0, 0), _GEL_BLOCK_MM, voxel_mm).labels
    x, y, z = _axes(labels, voxel_mm)
    middle = _VESSEL["depth"] + _VESSEL["slope"] * (x - _GEL_BLOCK_MM[0] / 2)
    apart = np.sqrt((y - _GEL_BLOCK_MM[1] / 2) ** 2 + (z - middle) ** 2)
    labels[apart < _VESSEL["radius"] + _VESSEL["wall"]] = 2
    labels[apart < _VESSEL["radius"]] = 1
    names = {0: "phantom gel", 1: "blood", 2: "vessel wall"}
    speckle = _like("liver", "phantom gel", backscatter_db=-3.0)
    tissues: dict[int, AcousticTissue | str] = {0: speckle, 1: "blood", 2: "vessel wall"}
    phantom = Phantom(_volume(labels, voxel_mm), tissues, flows=[_gel_flow()])
    centre = np.array([_GEL_BLOCK_MM[0] / 2, _GEL_BLOCK_MM[1] / 2, _VESSEL["depth"]])
    return GeneratedTissue(
        phantom=phantom, names=names, box=(np.zeros(3), np.array(_GEL_BLOCK_MM)), targets={"vessel": centre}
    )


def _gel_flow() -> Flow:
    """A pump's: steady, from left to right, and a little deeper."""
    wide, middle = _GEL_BLOCK_MM[0], _GEL_BLOCK_MM[1] / 2
    start, end = (_VESSEL["depth"] + _VESSEL["slope"] * (x - wide / 2) for x in (0.0, wide))
    return Flow(
        start=(0.0, middle, start), end=(wide, middle, end), radii_mm=(_VESSEL["radius"],) * 2,
        speed_cm_s=_VESSEL["speed_cm_s"],
    )  # fmt: skip


def cube(voxel_mm: float) -> GeneratedTissue:
    """Return the paper's cube at 100 mm a side, with thin sheets to see it deform by."""
    wide = (_CUBE_MM, _CUBE_MM + 2 * _BESIDE_MM, _CUBE_MM)
    labels = Canvas((0, 0, 0), wide, voxel_mm).labels
    for axis, place in enumerate(_axes(labels, voxel_mm)[:2]):  # square to the image of the middle plane
        off = np.abs((place - axis * _BESIDE_MM + _SHEETS_MM / 2) % _SHEETS_MM - _SHEETS_MM / 2)
        labels[np.broadcast_to((off <= _SHEET_MM / 2) & (place > 1), labels.shape)] = 1
    tissues = {0: _like("liver", "tissue"), 1: _like("liver", "sheet", backscatter_db=14.0)}
    phantom = Phantom(_volume(labels, voxel_mm, origin=(0, -_BESIDE_MM, 0)), tissues)
    target = np.array([0.6, 0.5, 0.5]) * _CUBE_MM
    return GeneratedTissue(
        phantom=phantom, names={0: "tissue", 1: "sheet"}, box=(np.zeros(3), np.full(3, _CUBE_MM)),
        targets={"end of the path": target}, homogeneous=True,
    )  # fmt: skip


PHANTOMS = {"kidney": kidney, "wide kidney": wide_kidney, "gel block": gel_block, "cube": cube}


def _axes(labels: NDArray[np.uint8], voxel_mm: float) -> list[Array]:
    return [
        (np.arange(n) * voxel_mm).reshape([-1 if a == axis else 1 for a in range(3)])
        for axis, n in enumerate(labels.shape)
    ]


def _volume(labels: NDArray[np.uint8], voxel_mm: float, origin: tuple[float, float, float] = (0, 0, 0)) -> Volume:
    return Volume(voxels=labels, spacing=(voxel_mm,) * 3, origin=np.array(origin, float))


def _like(tissue: str, name: str, **changes: Any) -> AcousticTissue:
    from dataclasses import replace

    return replace(TISSUES[tissue], name=name, texture_db=0.0, **changes)

"""A sensible scene of somebody's own data: the skin is found, an organ within reach, and a face that leads to it."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import FACES
from ..geometry.label_map import LabelMap
from ..geometry.volume import Volume
from ..io.labels import names_of, read_labels
from ..io.records import read
from ..io.volumes import read_volume
from ..mechanics.material_table import read_label_names
from ..simulator.scene_file import SceneFile
from ..ultrasound.organs import LARGEST_ORGAN, tissue_of
from ..ultrasound.reslice import swept

Mask = NDArray[np.bool_]
Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

_AIR_HU = -300
_CLOSING_MM, _SKIN_MM = 14.0, 4.0
_BESIDE_MM, _BELOW_MM = 75.0, 30.0
_TUBE_MM = 8.0
_BLOCKED_MM = 150.0
_REACH_MM = 140.0
"""How far a way whose every ray meets bone or gas counts as longer; and as far as a needle reaches."""
_WANTED = (
    (("lesion", "tumour", "tumor", "cyst", "kidney"), 0.0),
    (("liver", "prostate", "thyroid"), 20.0),
    (("spleen", "pancreas", "bladder", "breast"), 30.0),
)
_OTHERS_MM, _LAST_MM = 60.0, 500.0
_NO_TARGETS = ("bone", "gas", "muscle", "fat", "skin", "blood", "cartilage", "bowel wall")
_ENTRY_MM = 32.0
"""From the middle of the probe to the needle's entry."""


@dataclass(frozen=True)
class _Way:
    """From the skin to a place: voxels, mm."""

    face: str
    skin: NDArray[np.int64]
    length_mm: float
    blocked: float
    """Share of its neighbours, 8 mm around it, that meet bone or gas."""

    @property
    def cost_mm(self) -> float:
        return self.length_mm + _BLOCKED_MM * self.blocked


def own_scene(
    path: Path, *, labelled: bool, names: Path | None = None, ct: Path | None = None, face: str | None = None
) -> SceneFile:
    """Return a scene of a label map or of a real image that starts where one would: its line says why.

    The probe lies on the skin over a target, which is the middle of the organ that is reached best; the box begins
    at that skin, and the image is deep enough to show the target.

    Parameters
    ----------
    path : Path
        Label map, or image.
    labelled : bool
        Which of them it is.
    names, ct : Path, optional
        Names of the labels (by default beside them), and a CT of the same patient, in which air is found.
    face : str, optional
        The face the needle enters by; the best one by default.

    Raises
    ------
    ValueError
        A file that cannot be read.
    """
    tissue: dict[str, Any] = {"source": "labels" if labelled else "volume", "file": path.name}
    if names is not None:
        tissue["names"] = str(names.resolve())
    if ct is not None:
        tissue["ct"] = str(ct.resolve())
    elif labelled:
        tissue["between"] = "fat"  # which organs lie in: their capsules are seen
    volume: Volume = read_labels(path, largest=LARGEST_ORGAN) if labelled else read_volume(path)
    known = read_label_names(names_of(path, names)) if labelled else {}
    body = _body(volume, None if ct is None else read_volume(ct, name="ct")) if labelled else _seen(volume)
    blocks = np.isin(volume.voxels, [n for n, name in known.items() if _is(name, ("bone", "gas"))])
    found = _best(volume, body, blocks, _centres(volume, body, known), FACES if face is None else (face,))
    if found is None:
        logger.warning("no skin was found in %s; the probe rests on the middle of a face", path.name)
        return read(SceneFile, {"name": path.name, "tissue": tissue | {"entry_face": face or "y+"}})
    name, centre, way, others = found
    line = (
        f"{name} lies {way.length_mm:.0f} mm under the skin of face {way.face}"
        + (f", {100 * way.blocked:.0f} % of the way behind bone or gas" if way.blocked else ", nothing before it")
        + (f" ({', '.join(f'{o.face} {o.length_mm:.0f} mm' for o in others)})" if others else "")
    )
    logger.info("%s", line)
    low, high = _box(volume, centre, way)
    skin, target = volume.position(np.stack([way.skin, centre]).astype(float))
    depth = float(np.clip(10 * np.ceil((way.length_mm + _BELOW_MM) / 10), 40, 200))
    angle = float(np.degrees(np.arctan2(way.length_mm, -_ENTRY_MM)))
    return read(
        SceneFile,
        {
            "name": path.name,
            "description": line,
            "tissue": tissue | {"entry_face": way.face, "low": low.tolist(), "high": high.tolist()},
            "probe": {"at": skin.tolist(), "depth_mm": depth, "focus_mm": float(np.clip(way.length_mm, 5, 250))},
            "needle": {"u": _ENTRY_MM, "angle": angle, "length_mm": 150.0 if way.length_mm < 110 else 250.0},
            "targets": [{"name": name, "at": target.tolist()}],
        },
    )


def _is(name: str, tissues: tuple[str, ...]) -> bool:
    try:
        return tissue_of(name) in tissues
    except ValueError:
        return False


def _body(labels: Volume, ct: Volume | None) -> Mask:
    """What is patient: by the CT, else what lies among the labels, closed, and a skin around it."""
    from scipy.ndimage import distance_transform_edt

    if ct is not None:
        return _solid(ct.nearest_on(labels.lattice, outside=-1000))
    away = distance_transform_edt(labels.voxels == 0, sampling=labels.spacing)
    grown = np.pad(away < _CLOSING_MM, 1, mode="edge")
    inside = distance_transform_edt(grown, sampling=labels.spacing)[1:-1, 1:-1, 1:-1]
    return _filled(inside > _CLOSING_MM - _SKIN_MM)


def _solid(ct: Volume) -> Mask:
    """The largest part of a CT that is no air: neither the table, nor without its lungs and bowels."""
    from scipy.ndimage import label

    solid: Mask = ct.voxels > _AIR_HU
    parts, count = label(solid)
    return _filled(parts == 1 + np.argmax(np.bincount(parts.ravel())[1:]) if count > 1 else solid)


def _filled(solid: Mask) -> Mask:
    """With what it encloses, slice by slice."""
    from scipy.ndimage import binary_fill_holes

    filled: Mask = np.stack([binary_fill_holes(part) for part in np.moveaxis(solid, 2, 0)], axis=2)
    return filled


def _seen(volume: Volume) -> Mask:
    """What of an image is patient: all but the air of a CT, or all that a sweep saw."""
    if volume.voxels.min() < _AIR_HU:
        return _solid(volume)
    return swept(volume)


def _centres(volume: Volume, body: Mask, names: Mapping[int, str]) -> list[tuple[str, NDArray[np.int64], float]]:
    """Places worth reaching: their names, innermost voxels, and how much further away they may as well be, mm."""
    from scipy.ndimage import distance_transform_edt

    def innermost(mask: Mask) -> NDArray[np.int64]:
        inside = distance_transform_edt(np.pad(mask, 1), sampling=volume.spacing)[1:-1, 1:-1, 1:-1]
        return np.array(np.unravel_index(inside.argmax(), mask.shape))

    centres = []
    for number in np.unique(volume.voxels).tolist() if isinstance(volume, LabelMap) else ():
        name = names.get(number, "")
        if number and name:
            centres.append((name, innermost(volume.voxels == number), _reluctance(name)))
    if not centres and body.any():
        centres.append(("middle", innermost(body), 0.0))
    return centres


def _reluctance(name: str) -> float:
    for words, mm in _WANTED:
        if any(word in name.lower() for word in words):
            return mm
    return _LAST_MM if _is(name, _NO_TARGETS) else _OTHERS_MM


def _best(
    volume: Volume,
    body: Mask,
    blocks: Mask,
    centres: list[tuple[str, NDArray[np.int64], float]],
    faces: tuple[str, ...],
) -> tuple[str, NDArray[np.int64], _Way, list[_Way]] | None:
    """The place that is reached best, the way there, and the other ways to it."""
    found = []
    for name, centre, reluctance in centres:
        ways = [way for face in faces if (way := _way(volume, body, blocks, centre, face)) is not None]
        if ways:
            ways.sort(key=lambda way: way.cost_mm)
            beyond = 1e3 if ways[0].length_mm > _REACH_MM else 0.0
            found.append((ways[0].cost_mm + reluctance + beyond, name, centre, ways))
    if not found:
        return None
    _, name, centre, ways = min(found, key=lambda one: one[0])
    return name, centre, ways[0], ways[1:3]


def _way(volume: Volume, body: Mask, blocks: Mask, centre: NDArray[np.int64], face: str) -> _Way | None:
    """From a face's skin straight to a place; None where the patient is cut before there is skin."""
    axis, end = divmod(FACES.index(face), 2)
    side = 1 if end else -1
    reach = [max(1, round(_TUBE_MM / h)) for h in volume.spacing]
    low = [int(max(0, c - (0 if a == axis else r))) for a, (c, r) in enumerate(zip(centre, reach, strict=True))]
    high = [int(c + 1 + (0 if a == axis else r)) for a, (c, r) in enumerate(zip(centre, reach, strict=True))]
    low[axis], high[axis] = (int(centre[axis]), body.shape[axis]) if end else (0, int(centre[axis]) + 1)
    tube = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    line = np.moveaxis(body, axis, 0)[(slice(None), *np.delete(centre, axis))]
    outwards = line[centre[axis] :] if end else line[centre[axis] :: -1]
    outside = np.flatnonzero(~outwards)
    if outwards[-1]:
        return None
    skin = centre.copy()
    skin[axis] += side * (outside[-1] - int(np.argmax(outwards[outside[-1] :: -1])) if outwards.any() else 0)
    blocked = float(blocks[tube].any(axis=axis).mean())
    return _Way(face, skin, float(abs(skin[axis] - centre[axis]) * volume.spacing[axis]), blocked)


def _box(volume: Volume, centre: NDArray[np.int64], way: _Way) -> tuple[Array, Array]:
    """Opposite corners, in the world, of a box that begins at the skin and reaches around and below a place."""
    axis, end = divmod(FACES.index(way.face), 2)
    spacing = np.array(volume.spacing)
    low, high = centre - _BESIDE_MM / spacing, centre + _BESIDE_MM / spacing
    if end:
        low[axis], high[axis] = centre[axis] - _BELOW_MM / spacing[axis], way.skin[axis]
    else:
        low[axis], high[axis] = way.skin[axis], centre[axis] + _BELOW_MM / spacing[axis]
    last = np.array(volume.voxels.shape) - 1
    corners = volume.position(np.stack([np.maximum(low, 0), np.minimum(high, last)]))
    return corners[0], corners[1]

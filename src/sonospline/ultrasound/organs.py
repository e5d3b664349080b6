"""Scenes from segmented CT: organ names to acoustic tissues."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ..volume import Volume
from .acoustics import TISSUES
from .scene import Scene

_KINDS = {
    "kidney cortex": ("kidney", "adrenal"),
    "liver": ("liver",),
    "spleen": ("spleen",),
    "pancreas": ("pancreas", "prostate", "thyroid"),
    "blood": ("aorta", "vena_cava", "vein", "artery", "atrium", "heart", "portal"),
    "urine": ("gallbladder", "bladder", "cyst"),
    "gas": ("lung", "trachea"),
    "bowel wall": ("bowel", "colon", "duodenum", "stomach", "esophagus"),
    "bone": ("rib", "vertebra", "sacrum", "hip", "femur", "scapula", "sternum", "humerus", "clavicula", "skull"),
    "cartilage": ("cartilage",),
    "muscle": ("muscle", "autochthon", "iliopsoas", "gluteus"),
    "soft tissue": ("cord", "brain"),
}
_AIR_HU, _FAT_HU = -300, -30
_AIR, _FAT, _SOFT = 0, 254, 255


def tissue_of(organ: str) -> str:
    """Return the acoustic tissue of an organ's name, as TotalSegmentator writes it.

    Raises
    ------
    ValueError
        An organ it does not know; the message lists the tissues to choose from.

    Examples
    --------
    >>> from sonospline.ultrasound.organs import tissue_of
    >>> tissue_of("costal_cartilages"), tissue_of("rib_left_7"), tissue_of("gallbladder")
    ('cartilage', 'bone', 'urine')
    """
    # longer words first: costal_cartilages is no rib, gallbladder no bladder
    for word, tissue in sorted(((w, t) for t, words in _KINDS.items() for w in words), key=lambda pair: -len(pair[0])):
        if word in organ.lower():
            return tissue
    raise ValueError(
        f"organ {organ!r} has no acoustic properties; name its tissue, one of {', '.join(sorted(TISSUES))}"
    )


def read_organ_names(path: str | Path) -> dict[int, str]:
    """Read a CSV whose first two columns are label and organ name."""
    try:
        with Path(path).open(newline="") as file:
            rows = [row for row in csv.reader(file) if row]
        return {int(row[0]): row[1] for row in rows if row[0].strip().isdecimal()}
    except (OSError, IndexError, UnicodeDecodeError) as error:
        raise ValueError(f"names = {str(path)!r} cannot be read ({error}); give a CSV of label, name") from None


def scene_from_organs(
    labels: Volume, names: dict[int, str], *, ct: Volume | None = None, spacing_mm: float | None = 1.0
) -> Scene:
    """Return a scene from organ labels, finer than they are.

    Parameters
    ----------
    labels : Volume
        Organ labels 1 to 253; 0 where there is none.
    names : dict of int to str
        Their names.
    ct : Volume, optional
        CT on the same lattice: tells fat, soft tissue and air apart where there is no label. Without it,
        unlabelled voxels are soft tissue.
    spacing_mm : float, optional
        Lattice to refine to; None keeps the labels' own.
    """
    voxels = labels.voxels.astype(np.uint8)
    if labels.voxels.max() >= _FAT:
        raise ValueError(f"labels go up to {labels.voxels.max()}; give organ labels 1 to {_FAT - 1}")
    if ct is not None and ct.voxels.shape != voxels.shape:
        raise ValueError(f"ct has shape {ct.voxels.shape}; give one on the labels' lattice, {voxels.shape}")
    unlabelled = voxels == 0
    if ct is None:
        voxels[unlabelled] = _SOFT
    else:
        voxels[unlabelled & (ct.voxels > _FAT_HU)] = _SOFT
        voxels[unlabelled & (ct.voxels > _AIR_HU) & (ct.voxels <= _FAT_HU)] = _FAT
    present = {int(label) for label in np.unique(voxels)} - {_AIR, _FAT, _SOFT}
    for label in sorted(present - set(names)):
        raise ValueError(f"label {label} has no name; add it to names, e.g. names[{label}] = 'liver'")
    tissues = {_AIR: "gel", _FAT: "fat", _SOFT: "soft tissue"} | {label: tissue_of(names[label]) for label in present}
    volume = Volume(voxels=voxels, spacing=labels.lattice.spacing, origin=labels.origin, direction=labels.direction)
    scene = Scene(volume, tissues)  # type: ignore[arg-type]
    return scene if spacing_mm is None else scene.refined(spacing_mm)

"""Phantoms from segmented CT: organ names to acoustic tissues."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._shown import shown
from ..geometry.label_map import LabelMap
from ..geometry.volume import Volume
from .acoustics import TISSUES, AcousticTissue
from .phantom import Phantom

_KINDS = {
    "kidney cortex": ("kidney", "adrenal"),
    "liver": ("liver",),
    "spleen": ("spleen",),
    "pancreas": ("pancreas", "prostate", "thyroid"),
    "blood": ("aorta", "vena_cava", "vein", "artery", "atrium", "heart", "portal"),
    "urine": ("gallbladder", "bladder", "cyst", "kidney_cyst"),
    "fat": ("fat", "adipose"),
    "skin": ("skin",),
    "gas": ("lung", "trachea"),
    "bowel wall": ("bowel", "colon", "duodenum", "stomach", "esophagus"),
    "bone": ("rib", "vertebra", "sacrum", "hip", "femur", "scapula", "sternum", "humerus", "clavicula", "skull"),
    "cartilage": ("cartilage",),
    "muscle": ("muscle", "autochthon", "iliopsoas", "gluteus"),
    "soft tissue": ("cord", "brain", "soft_tissue", "tumour", "tumor", "lesion"),
}
_AIR_HU, _FAT_HU = -300, -30
_AIR, _FAT, _SOFT = 0, 254, 255
_BEYOND_CT_HU = -1000

LARGEST_ORGAN = 253
"""Largest label of an organ: 254 and 255 are the fat and the soft tissue between them."""

logger = logging.getLogger(__name__)


def tissue_of(organ: str) -> str:
    """Return the acoustic tissue of an organ's name, as TotalSegmentator writes it, or of its own name.

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
    if organ in TISSUES:
        return organ
    # longer words first: costal_cartilages is no rib, gallbladder no bladder
    for word, tissue in sorted(((w, t) for t, words in _KINDS.items() for w in words), key=lambda pair: -len(pair[0])):
        if word in organ.lower():
            return tissue
    raise ValueError(
        f"organ {organ!r} has no acoustic properties; name its tissue, one of {', '.join(sorted(TISSUES))}"
    )


def as_phantom(what: Phantom | Volume, tissues: Mapping[int, AcousticTissue | str] | None = None) -> Phantom:
    """Return what can be imaged as a phantom.

    Parameters
    ----------
    what : Phantom, LabelMap or Volume
        A label map with names becomes the phantom of its organs, see :func:`phantom_from_organs`; any labels are
        one with ``tissues``.
    tissues : mapping of int to AcousticTissue or str, optional
        Acoustic tissue of each label.

    Raises
    ------
    ValueError
        Something else, or labels of which neither names nor tissues are known.
    """
    if isinstance(what, Phantom):
        if tissues is not None:
            raise ValueError("tissues were given for a Phantom, which has its own; give labels, or leave them out")
        return what
    if not isinstance(what, Volume):
        raise ValueError(f"phantom = {shown(what)} is none; give a Phantom, or labels, e.g. of read_labels")
    if tissues is not None:
        return Phantom(what, tissues)
    if not (isinstance(what, LabelMap) and what.names):
        raise ValueError(f"phantom = {what!r} has no names; read it with them, or give tissues, e.g. {{1: 'liver'}}")
    return phantom_from_organs(what)


def phantom_from_organs(
    labels: Volume,
    names: Mapping[int, str] | None = None,
    *,
    ct: Volume | None = None,
    between: str = "soft tissue",
    spacing_mm: float | None = 1.0,
) -> Phantom:
    """Return a phantom from organ labels, finer than they are.

    Parameters
    ----------
    labels : Volume
        Organ labels 1 to 253; 0 where there is none.
    names : mapping of int to str, optional
        Their names; by default those that the label map carries.
    ct : Volume, optional
        CT of the same patient: tells fat, soft tissue and air apart where there is no label. On another
        lattice than the labels, its nearest voxel is taken, and air where it ends. Without it, unlabelled
        voxels are soft tissue.
    between : {"soft tissue", "fat"}
        What lies between organs, where there is no CT: in fat their capsules are seen.
    spacing_mm : float, optional
        Lattice to refine to; None keeps the labels' own.

    Raises
    ------
    ValueError
        Labels that are not whole numbers 0 to 253, one that has no name or whose organ is not known, or a CT
        that lies elsewhere.
    """
    labels = LabelMap.of(labels, largest=LARGEST_ORGAN)
    names = labels.names if names is None else names
    voxels = labels.voxels.astype(np.uint8)
    unlabelled = voxels == 0
    if ct is None:
        voxels[unlabelled] = {"soft tissue": _SOFT, "fat": _FAT}[
            _validate.choice("between", between, ("soft tissue", "fat"))
        ]
    else:
        hu = _hounsfield(ct, labels)
        voxels[unlabelled & (hu > _FAT_HU)] = _SOFT
        voxels[unlabelled & (hu > _AIR_HU) & (hu <= _FAT_HU)] = _FAT
    present = {int(label) for label in np.unique(voxels)} - {_AIR, _FAT, _SOFT}
    for label in sorted(present - set(names)):
        raise ValueError(f"label {label} has no name; add it to names, e.g. names[{label}] = 'liver'")
    tissues = {_AIR: "gel", _FAT: "fat", _SOFT: "soft tissue"} | {label: tissue_of(names[label]) for label in present}
    volume = Volume(voxels=voxels, spacing=labels.lattice.spacing, origin=labels.origin, direction=labels.direction)
    phantom = Phantom(volume, tissues)
    return phantom if spacing_mm is None else phantom.refined(spacing_mm)


def _hounsfield(ct: Volume, labels: LabelMap) -> NDArray[Any]:
    """The CT's voxels where the labels' are."""
    if ct.lies_on(labels.lattice):
        return ct.voxels
    covered = replace(ct, voxels=np.ones(ct.voxels.shape, np.uint8)).nearest_on(labels.lattice, outside=0).voxels
    if not covered.any():
        raise ValueError("ct does not overlap the labels; give a CT of the same patient in the same frame")
    if not covered.all():
        logger.warning("ct covers %.0f %% of the label map; where it ends is air", 100 * covered.mean())
    hu = ct.nearest_on(labels.lattice, outside=0).voxels
    return np.where(covered, hu, _BEYOND_CT_HU)

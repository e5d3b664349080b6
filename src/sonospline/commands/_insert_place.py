"""Where ``sonospline insert`` pushes its needle: the image, and the needle's path in the world."""

from __future__ import annotations

import argparse
import logging

import numpy as np
from numpy.typing import NDArray

from ..geometry.label_map import LabelMap, looks_like_labels
from ..geometry.layered_block import default_needle, layered_block
from ..geometry.needle import Needle
from ..geometry.volume import Volume
from ..io.volumes import RAS_TO_LPS, read_volume
from ..mechanics.tissue_map import TissueMap
from . import _points

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)


def needle_path(args: argparse.Namespace, volume: Volume) -> Needle:
    """Return the needle at its target: as asked for, or through the middle of a generated image or of labels."""
    if args.entry is None and args.target is None and args.volume is None:
        return default_needle() if args.labels is None else _anterior_needle(volume)
    for name in ("entry", "target"):
        if getattr(args, name) is None:
            centre = ",".join(f"{x:.0f}" for x in volume.lattice.world(volume.lattice.extent[None] / 2)[0])
            raise ValueError(f"--{name} is missing; give X,Y,Z inside the image, whose centre is {centre} (RAS mm)")
    entry, target = (_world(name, getattr(args, name), args.frame, volume) for name in ("entry", "target"))
    if np.allclose(entry, target, rtol=0, atol=1e-9 * volume.lattice.side):
        raise ValueError(f"--target {args.target} equals --entry; move the target to where the tip should end")
    return Needle(entry, target)


def _anterior_needle(volume: Volume) -> Needle:
    """From the middle of the face that looks most to the front (RAS +y) to the middle of the box."""
    lattice = volume.lattice
    axis = int(np.abs(lattice.direction[1]).argmax())
    middle = lattice.extent / 2
    entry = middle.copy()
    entry[axis] = lattice.extent[axis] if lattice.direction[1, axis] > 0 else 0.0
    return Needle(*lattice.world(np.stack([entry, middle])))


def _world(name: str, text: str, frame: str, volume: Volume) -> Array:
    point = _points.parse(name, text)
    if _points.is_markups(text):
        return point
    if frame == "IJK":
        return volume.position(point[None])[0]
    return RAS_TO_LPS @ point if frame == "LPS" else point


def image(args: argparse.Namespace, tissues: TissueMap | None) -> Volume:
    """Return the image to deform: the one given, else one that shows the labelled tissue, else the phantom."""
    if args.volume:
        volume = read_volume(args.volume)
        kind = args.volume_kind
        if kind == "auto" and looks_like_labels(volume):
            logger.warning(
                "volume = %r is taken for a label map: its voxels move but are never interpolated "
                "(--volume-kind image takes it for an image)",
                str(args.volume),
            )
            kind = "labels"
        return LabelMap.of(volume, name=f"volume = {str(args.volume)!r}") if kind == "labels" else volume
    return layered_block(args.seed) if tissues is None else tissues.stiffness_image()

"""Segmentations of 3D Slicer (``.seg.nrrd``): named segments in one layer or several, with their terminology."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from ..geometry.label_map import LabelMap
from ..geometry.volume import Volume
from .volumes import from_sitk, place, read_image
from .writing import write_image

SUFFIX = ".seg.nrrd"
Colour = tuple[float, float, float]
_FIELD = re.compile(r"Segment(\d{1,5})_(\w+)", re.ASCII)
_GREY: Colour = (0.5, 0.5, 0.5)
_TERMINOLOGY = "TerminologyEntry:"
_MOST_LAYERS = 64


@dataclass(frozen=True)
class Segment:
    """One structure of a segmentation.

    Parameters
    ----------
    name : str
    label : int
        Its value in its layer.
    layer : int, default: 0
    colour : (3,) tuple of float, default: grey
        0 to 1.
    terminology : str, default: ""
        What it is, as 3D Slicer writes it: contexts, categories and types with their codes, parted by ``~`` and ``^``.
    """

    name: str
    label: int
    layer: int = 0
    colour: Colour = _GREY
    terminology: str = ""

    @property
    def codes(self) -> tuple[str, ...]:
        """Scheme, value and meaning of its category and type (``SCT^10200004^Liver``), where it has any."""
        return tuple(part for part in self.terminology.split("~")[1:3] if part.strip("^"))


@dataclass(frozen=True, eq=False, repr=False)
class Segmentation:
    """Segments on one lattice. Those of one layer never overlap; those of several may.

    Parameters
    ----------
    layers : tuple of Volume
        Whole numbers, on one lattice.
    segments : tuple of Segment

    Examples
    --------
    >>> import numpy as np
    >>> import sonospline as ss
    >>> from sonospline.io.segmentation import Segment, Segmentation
    >>> layer = ss.Volume(voxels=np.full((4, 4, 4), 2, np.uint8), spacing=(1, 1, 1))
    >>> both = Segmentation((layer, layer), (Segment("liver", 2), Segment("tumour", 2, layer=1)))
    >>> both, both.labels().names, int(both.labels().voxels.max())
    (Segmentation(4 x 4 x 4, 2 layers: liver, tumour), {1: 'liver', 2: 'tumour'}, 2)
    """

    layers: tuple[Volume, ...]
    segments: tuple[Segment, ...]

    def labels(self) -> LabelMap:
        """Return all in one label map with names; where segments overlap, the later one is there.

        Labels stay what they are where all segments are in one layer; else they are 1, 2, ... in the segments' order.
        """
        first = self.layers[0]
        if len(self.layers) == 1:
            known = [segment.label for segment in self.segments]
            voxels: NDArray[Any] = np.where(np.isin(first.voxels, known), first.voxels, 0)
            names = {segment.label: segment.name for segment in self.segments}
        else:
            voxels = np.zeros(first.voxels.shape, np.uint16)
            names = {}
            for number, segment in enumerate(self.segments, 1):
                voxels[self.layers[segment.layer].voxels == segment.label] = number
                names[number] = segment.name
        lattice = first.lattice
        return LabelMap(
            voxels=voxels, spacing=lattice.spacing, origin=lattice.origin, direction=lattice.direction, names=names
        )

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.layers[0].voxels.shape))
        names = ", ".join(segment.name for segment in self.segments[:6]) + (", ..." if len(self.segments) > 6 else "")
        return f"Segmentation({shape}, {len(self.layers)} layer{'s' * (len(self.layers) > 1)}: {names})"


def read_segmentation(path: str | PathLike[str]) -> Segmentation:
    """Read a segmentation.

    Raises
    ------
    ValueError
        A file that cannot be read, holds no segments, or says of one what cannot be.
    """
    return segmentation_of(read_image(Path(path), "segmentation"), f"segmentation = {str(path)!r}")


def names_segments(image: Any) -> bool:
    """Return whether a SimpleITK image says what its labels are, as 3D Slicer writes it."""
    return any(_FIELD.fullmatch(key) for key in image.GetMetaDataKeys())


def segmentation_of(image: Any, where: str) -> Segmentation:
    """Return the segmentation that a SimpleITK image holds; errors begin with ``where``."""
    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() > _MOST_LAYERS:
        raise ValueError(f"{where} is no segmentation: give layers of 3-D label maps, {_MOST_LAYERS} at most")
    sitk, count = require("SimpleITK"), image.GetNumberOfComponentsPerPixel()
    parts = [image] if count == 1 else [sitk.VectorIndexSelectionCast(image, k) for k in range(count)]
    layers = tuple(from_sitk(part) for part in parts)
    fields: dict[int, dict[str, str]] = {}
    for key in image.GetMetaDataKeys():
        found = _FIELD.fullmatch(key)
        if found is not None:
            fields.setdefault(int(found[1]), {})[found[2]] = image.GetMetaData(key)
    segments = tuple(_segment(where, fields[number], count) for number in sorted(fields))
    if not segments:
        raise ValueError(f"{where} names no segments (Segment0_Name); save it as a segmentation in 3D Slicer")
    taken = {(segment.layer, segment.label) for segment in segments}
    if len(taken) < len(segments):
        raise ValueError(f"{where} has two segments of one label in one layer; save it anew in 3D Slicer")
    return Segmentation(layers, segments)


def write_segmentation(segmentation: Segmentation, path: str | PathLike[str]) -> None:
    """Write a segmentation; a path that does not end in ``.seg.nrrd`` is refused, since 3D Slicer goes by that.

    Raises
    ------
    ValueError
        Another suffix, layers on different lattices, or a segment of a layer that is not there.
    OSError
        The file could not be written whole.
    """
    if not str(path).lower().endswith(SUFFIX):
        raise ValueError(f"path = {str(path)!r} does not end in {SUFFIX}; give one that does")
    first = segmentation.layers[0].lattice
    if any(layer.lattice != first for layer in segmentation.layers):
        raise ValueError("layers are on different lattices; resample them to one")
    for segment in segmentation.segments:
        if not 0 <= segment.layer < len(segmentation.layers):
            raise ValueError(
                f"segment {segment.name!r} is in layer {segment.layer}; there are {len(segmentation.layers)}"
            )
    sitk = require("SimpleITK")
    stack = [layer.voxels.astype(np.uint16 if layer.voxels.max() > 255 else np.uint8) for layer in segmentation.layers]
    widest = np.result_type(*stack)
    arrays = [voxels.astype(widest).transpose(2, 1, 0) for voxels in stack]
    image = sitk.GetImageFromArray(arrays[0] if len(arrays) == 1 else np.stack(arrays, -1), isVector=len(arrays) > 1)
    place(image, first)
    for key, value in _header(segmentation).items():
        image.SetMetaData(key, value)
    write_image(image, path)


def of_labels(labels: LabelMap, colours: Sequence[Colour] | None = None) -> Segmentation:
    """Return the segmentation of a label map: a segment for each label that it holds and that has a name."""
    held = [int(number) for number in np.unique(labels.voxels) if number and int(number) in labels.names]
    drawn = [tuple(np.random.default_rng(number).uniform(0.2, 0.95, 3).tolist()) for number in held]
    chosen = drawn if colours is None else list(colours)
    segments = (Segment(labels.names[n], n, colour=c) for n, c in zip(held, chosen, strict=True))
    return Segmentation((labels,), tuple(segments))


def _header(segmentation: Segmentation) -> dict[str, str]:
    extent = " ".join(f"0 {n - 1}" for n in segmentation.layers[0].voxels.shape)
    fields = {
        "Segmentation_ContainedRepresentationNames": "Binary labelmap|",
        "Segmentation_SourceRepresentation": "Binary labelmap",
        "Segmentation_ReferenceImageExtentOffset": "0 0 0",
    }
    for number, segment in enumerate(segmentation.segments):
        parts = {
            "ID": f"Segment_{number + 1}", "Name": segment.name, "LabelValue": str(segment.label),
            "Layer": str(segment.layer), "Color": " ".join(f"{c:.6g}" for c in segment.colour), "Extent": extent,
            "NameAutoGenerated": "0", "ColorAutoGenerated": "0",
            "Tags": f"{_TERMINOLOGY}{segment.terminology}|" if segment.terminology else "|",
        }  # fmt: skip
        fields |= {f"Segment{number}_{key}": value for key, value in parts.items()}
    return fields


def _segment(where: str, fields: dict[str, str], layers: int) -> Segment:
    name = fields.get("Name") or fields.get("ID") or "segment"
    try:
        label, layer = int(fields.get("LabelValue", "1")), int(fields.get("Layer", "0"))
        r, g, b = (float(part) for part in fields.get("Color", "0.5 0.5 0.5").split())
    except ValueError:
        raise ValueError(f"{where}: segment {name[:40]!r} has a label, a layer or a colour that is no number") from None
    if not (0 <= layer < layers and 0 < label < 1 << 16):
        raise ValueError(f"{where}: segment {name[:40]!r} is label {label} of layer {layer}; there are {layers} layers")
    tags = [tag for tag in fields.get("Tags", "").split("|") if tag.startswith(_TERMINOLOGY)]
    return Segment(name, label, layer, (r, g, b), tags[0][len(_TERMINOLOGY) :] if tags else "")

"""A scene of 3D Slicer that shows an insertion: the images under the deformation, and deformed; the needle; its way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from ..geometry.label_map import LabelMap
from ..geometry.needle import Needle
from ..geometry.needle_surface import STEEL, needle_surface
from ..geometry.pose import pose_along
from ..geometry.volume import Volume
from .mrml import FOUR_UP, GREY, Mrml, nrrd_bytes
from .segmentation import SUFFIX, of_labels, write_segmentation

Array = NDArray[np.float64]

_VIEWS = {
    "Red": [(-1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "Yellow": [(0, -1, 0), (0, 0, 1), (-1, 0, 0)],
    "Green": [(-1, 0, 0), (0, 0, 1), (0, 1, 0)],
}
"""What is to the right, up and towards the viewer in an axial, a sagittal and a coronal slice (RAS)."""


def insertion_scene(
    images: Mapping[str, tuple[Volume, Volume]], deformation: bytes, needle: Needle, target: NDArray[np.floating]
) -> Mrml:
    """Return a scene with everything ready to use.

    Parameters
    ----------
    images : mapping of str to (Volume, Volume)
        Each image by its name, as it was and deformed; the first one is shown. Label maps become segments.
    deformation : bytes
        The file (.h5) of the ITK transform that deforms them: the images as they were hang from it, so that 3D Slicer
        shows them deformed too, and hardens them to the deformed ones.
    needle : Needle
        Where it ended.
    target : (3,) ndarray
        Where it was to end.
    """
    scene = Mrml()
    stored = scene.stored("TransformStorage", "deformation.h5", deformation)
    moved = {"transform": scene.add("Transform", "deformation", references={"storage": stored})}
    volumes = []
    for name, (before, after) in images.items():
        _add(scene, name, before, moved)
        shown = _add(scene, f"warped {name}", after)
        if not isinstance(after, LabelMap):
            volumes.append(shown)
    points, triangles = needle_surface(needle.depth)
    pose = pose_along(needle.tip, needle.direction)
    scene.surface("needle", points @ pose[:3, :3].T + pose[:3, 3], triangles, STEEL)
    scene.fiducials("path", {"entry": needle.entry, "target": target})
    _show(scene, volumes, next(iter(images.values()))[0].lattice.side, needle.tip)
    return scene


def _add(scene: Mrml, name: str, volume: Volume, references: Mapping[str, str] | None = None) -> str:
    if isinstance(volume, LabelMap):
        segments = ("SegmentationStorage", f"{name}{SUFFIX}", _segments(volume))
        return scene.shown("Segmentation", name, segments, references)
    data = nrrd_bytes(volume.voxels.transpose(2, 1, 0), _places(volume), level=1)  # quickly: it may be large
    file = ("VolumeArchetypeStorage", f"{name}.nrrd", data)
    return scene.shown("Volume", name, file, references, colorNodeID=GREY, autoWindowLevel=1, interpolate=1)


def _segments(labels: LabelMap) -> bytes:
    """The labels as a segmentation's file; a label without a name is called by its number."""
    names = {label: labels.names.get(label, f"label {label}") for label in labels.present if label}
    with TemporaryDirectory() as folder:
        write_segmentation(of_labels(labels.named(names)), path := Path(folder, f"labels{SUFFIX}"))
        return path.read_bytes()


def _places(volume: Volume) -> Array:
    """From indices to RAS mm."""
    matrix = np.eye(4)
    matrix[:3, :3] = volume.lattice.direction * volume.lattice.spacing
    matrix[:3, 3] = volume.lattice.origin
    return matrix


def _show(scene: Mrml, volumes: Sequence[str], side: float, tip: Array) -> None:
    """Three slices through the needle's tip, of the first volume where there is one."""
    for view, axes in _VIEWS.items():
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = np.transpose(axes), tip
        scene.slice_view(view, place, *volumes[:1], fieldOfView=np.array([side, side, 1]))
    scene.add("Layout", "Layout", currentViewArrangement=FOUR_UP)

"""A segmentation that comes as IMAGE and LBMETA, made into a scene."""

from __future__ import annotations

import csv
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import igtl
from ..geometry.volume import Volume
from ..io.records import read
from ..io.volumes import write_volume
from ..simulator.scene import Scene
from ..simulator.scene_file import SceneFile
from ..simulator.scene_maker import make_scene
from .coordinate_frames import CoordinateFrames

_MOST_IMAGES = 4
_ANTERIOR = np.array([0.0, 1.0, 0.0])
"""Where the skin is looked for: patients lie on their backs (assumed)."""


class SceneReceiver:
    """Keeps the last images; where a list of structures says what one of them holds, a scene is made of it.

    Parameters
    ----------
    frames : CoordinateFrames
        Images come in its reference.
    load : callable
        Called with the scene, in a thread of its own: making it takes seconds.
    warn : callable
        Called with one line where none could be made.
    """

    def __init__(
        self, frames: CoordinateFrames, load: Callable[[Scene], object], warn: Callable[[str], object]
    ) -> None:
        self._frames, self._load, self._warn = frames, load, warn
        self._images: OrderedDict[str, igtl.Image] = OrderedDict()
        self._making: threading.Thread | None = None

    def take(self, message: igtl.Message) -> None:
        """Take an image, or a list of structures.

        Raises
        ------
        ValueError
            Structures of an image that did not come before, or while another scene is being made.
        """
        if isinstance(message.content, igtl.Image):
            self._images[message.device] = message.content
            self._images.move_to_end(message.device)
            while len(self._images) > _MOST_IMAGES:
                self._images.popitem(last=False)
        elif isinstance(message.content, igtl.LabelList):
            self._begin(message.content)

    def _begin(self, structures: igtl.LabelList) -> None:
        names = {entry.label: entry.name for entry in structures.entries if entry.label}
        of = {name for entry in structures.entries for name in (entry.owner, entry.id) if name in self._images}
        if len(of) != 1 or not names:
            raise ValueError(f"structures are of {len(of)} images that came; send the label map first, then its LBMETA")
        if self._making is not None and self._making.is_alive():
            raise ValueError("another scene is being made; send the structures again when it is there")
        [device] = of
        self._making = threading.Thread(target=self._make, args=(device, self._images[device], names), daemon=True)
        self._making.start()

    def _make(self, device: str, image: igtl.Image, names: dict[int, str]) -> None:
        try:
            self._load(scene_of(image, names, self._frames.reference_to_world, name=device))
        except Exception as error:  # of libraries that read and make scenes: the present one goes on
            self._warn(f"{device}: no scene was made: {error}")


def scene_of(image: igtl.Image, names: dict[int, str], reference_to_world: NDArray[np.float64], *, name: str) -> Scene:
    """Return the scene of a label map; the skin is its face that looks most to the front.

    Raises
    ------
    ValueError
        Several components, or a label map that makes no scene.
    """
    if image.voxels.ndim != 3:
        raise ValueError(f"its voxels have {image.voxels.shape[3]} components; send a label map")
    ijk = reference_to_world @ image.ijk_to_reference
    spacing = np.linalg.norm(ijk[:3, :3], axis=0)
    direction = ijk[:3, :3] / spacing
    volume = Volume(voxels=image.voxels.transpose(2, 1, 0), spacing=spacing, origin=ijk[:3, 3], direction=direction)
    front = direction.T @ _ANTERIOR
    axis = int(np.argmax(np.abs(front)))
    with tempfile.TemporaryDirectory() as folder:
        write_volume(volume, Path(folder, "labels.nrrd"))
        with Path(folder, "labels.csv").open("w", newline="") as stream:
            csv.writer(stream).writerows([("label", "name"), *sorted(names.items())])
        tissue = {
            "source": "labels",
            "file": "labels.nrrd",
            "entry_face": f"{'xyz'[axis]}{'+' if front[axis] > 0 else '-'}",
        }
        try:
            return make_scene(read(SceneFile, {"name": name, "tissue": tissue}), folder=Path(folder))
        except ValueError as error:
            raise ValueError(str(error).replace(f"{folder}/", "")) from None

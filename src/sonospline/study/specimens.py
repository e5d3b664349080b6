"""What the models are compared in: generated cubes, the kidney scene, and the label maps of patients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid
from ..geometry.label_map import LabelMap
from ..geometry.tissue import Tissue
from ..mechanics import labelled_cube
from ..mechanics.default_load import default_load
from ..mechanics.labelled_cubes import TISSUES
from ..mechanics.line_force import LineForce
from ..mechanics.loads import LineLoad
from ..mechanics.material import Material
from ..mechanics.tissue_map import TissueMap
from ..models.maker import DEFAULT_KPA
from ..phantoms.kidney import LABELS
from ..simulator import make_scene
from .insertions import PlannedInsertion, held_out_insertions

_PLACES = 12
"""So many places along each axis of a map, at most, are tried for the cube that is cut from it."""
_PART = 2e-3
"""Of the cube's voxels: a tissue with less of them does not count."""


@dataclass(frozen=True, eq=False)
class Specimen:
    """A block of labelled tissue, and the needles that go into it."""

    name: str
    tissue: Tissue
    """The nodes that are compared, and the free face."""
    tissues: TissueMap
    names: Mapping[int, str]
    """Of its labels."""
    insertions: tuple[PlannedInsertion, ...]
    load: LineLoad | None = None
    """What a needle does; None for what the tissue along it asks for."""

    @property
    def real(self) -> bool:
        """Whether it is in mm, kPa and N: models that know no labels are then brought to the reference's size."""
        return self.load is None

    @property
    def uniform(self) -> Material:
        """Return the material of finite elements that are told no labels."""
        return Material(DEFAULT_KPA) if self.real else Material()

    def load_without_labels(self) -> LineLoad:
        """Return the same load for a model that knows no labels."""
        return default_load(self.tissues) if self.load is None else self.load


def cube(name: str, side: int) -> Specimen:
    """Return a labelled unit cube with so many nodes a side, under the load that the paper's model is tuned on."""
    return Specimen(
        name,
        Tissue(Grid.unit_cube(side)),
        labelled_cube(name),
        dict(enumerate(TISSUES[name])),
        held_out_insertions(),
        LineForce(),
    )


def kidney(nodes: int) -> Specimen:
    """Return the tissue of the shipped kidney scene, with about so many nodes."""
    scene = make_scene("kidney")
    assert scene.tissues is not None
    grid = scene.tissue.grid
    covering = Grid.covering(grid.extent, nodes=nodes, origin=grid.origin, direction=grid.direction)
    return _clear_of_bone("kidney scene", Tissue(covering, scene.tissue.entry_face), scene.tissues, LABELS)


def name_of(path: Path) -> str:
    """Return what a label map is called in tables: its file's name without endings."""
    return path.name.partition(".")[0].replace("_", " ")


def patient(name: str, labels: LabelMap, nodes: int) -> Specimen:
    """Return the cube of a label map in which most tissues meet, its face to the front free.

    Its side is the shortest of the map's. Materials are the assumed ones, by the labels' names.

    Raises
    ------
    ValueError
        Labels without names, a name without a material, or bone in the way of every needle.
    """
    tissues, lattice = TissueMap.of(labels), labels.lattice
    side = float(lattice.extent.min())
    start = lattice.world((_busiest_cube(labels, side) * lattice.spacing)[None])[0]
    grid = Grid.covering((side,) * 3, nodes=nodes, origin=start, direction=lattice.direction)
    axis = int(np.abs(lattice.direction[1]).argmax())
    face = "xyz"[axis] + ("+" if lattice.direction[1, axis] > 0 else "-")
    return _clear_of_bone(name, Tissue(grid, face), tissues, labels.names)


def _clear_of_bone(name: str, tissue: Tissue, tissues: TissueMap, names: Mapping[int, str]) -> Specimen:
    """A specimen with the held-out insertions that no bone stops."""
    insertions = tuple(plan for plan in held_out_insertions() if tissues.obstacle(plan.on(tissue)) is None)
    if not insertions:
        raise ValueError(f"{name}: every insertion of the study meets bone there; give another label map")
    return Specimen(name, tissue, tissues, names, insertions)


def _busiest_cube(labels: LabelMap, side: float) -> NDArray[np.int64]:
    """First voxel of the cube of a side in which most tissues meet; of equals, the fullest."""
    size = np.floor(side / np.array(labels.spacing) + 1e-9).astype(int) + 1
    ends = np.array(labels.voxels.shape) - size
    axes = [np.unique(np.linspace(0, end, min(end + 1, _PLACES)).astype(int)) for end in ends]

    def worth(first: tuple[int, ...]) -> tuple[int, int]:
        held = labels.voxels[tuple(slice(f, f + n) for f, n in zip(first, size, strict=True))]
        found, counts = np.unique(held, return_counts=True)
        return int((counts >= _PART * held.size).sum()), int(counts[found > 0].sum())

    return np.array(max(product(*axes), key=worth))

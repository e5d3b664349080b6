"""What the source of a scene holds: a generated phantom, a label map, or a real 3-D image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid
from ..geometry.volume import Volume
from ..io.labels import labels_named, names_for, read_labels, warn_of_labels
from ..io.volumes import read_volume
from ..mechanics.material_table import BACKGROUND, MaterialTable
from ..mechanics.membranes import Membrane
from ..mechanics.tissue_map import TissueMap
from ..phantoms.generated import MECHANICAL_VOXEL_MM, PHANTOMS, PaintedDent
from ..ultrasound.needle_echo import LOOKS
from ..ultrasound.organs import LARGEST_ORGAN, phantom_from_organs
from ..ultrasound.phantom import Phantom
from ..ultrasound.probe import Probe
from ..ultrasound.reslice import Reslicer, swept
from .imaging import Imager, ReslicedImager, SyntheticImager, grey_range
from .scene_file import SceneFile
from .scene_view import view_of

Array = NDArray[np.float64]
Progress = Callable[[float], None]


class Undented(NamedTuple):
    """What a phantom that is painted with the dent of a probe is like without it."""

    at: Array
    """(3,) the middle of the face of the probe that dents it, world."""
    tissues: Callable[[], TissueMap]
    """Makes them."""
    phantom: Callable[[float], Phantom]
    """Makes it, of a voxel size."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneContent:
    """The lattice, labels for the eye and for mechanics, and how it looks."""

    grid: Grid
    see: Callable[[Probe, Array], Imager]
    targets: Mapping[str, Array]
    tissues: TissueMap | None = None
    labels: Volume | None = None
    names: Mapping[int, str] | None = None
    phantom: Phantom | None = None
    """What a synthetic picture is of."""
    undented: Undented | None = None


def read_content(spec: SceneFile, folder: Path, progress: Progress) -> SceneContent:
    """Return what a scene's source holds; its files are seen from a folder."""
    read = {"labels": _labels, "volume": _volume}.get(spec.tissue.source, _generated)
    return _with_membranes(read(spec, folder, progress), spec)


def _with_membranes(content: SceneContent, spec: SceneFile) -> SceneContent:
    if not spec.membranes:
        return content
    if content.tissues is None:
        raise ValueError("membranes are between labelled tissues, and this scene has none; leave them out")
    membranes = tuple(Membrane(m.name, m.around, m.rupture_force_n, m.rate, m.source) for m in spec.membranes)
    return replace(content, tissues=replace(content.tissues, membranes=membranes))


def _generated(spec: SceneFile, folder: Path, progress: Progress) -> SceneContent:
    made = PHANTOMS[spec.tissue.source](spec.tissue.voxel_mm)
    progress(0.5)
    low, high = made.box
    coarse = _coarser(made.phantom.labels)
    labelled, materials = not made.homogeneous, scene_materials(spec, folder)
    return SceneContent(
        grid=Grid.covering(high - low, nodes=spec.tissue.nodes, origin=low),
        see=_synthetic(spec, made.phantom),
        targets=made.targets,
        tissues=TissueMap.named(coarse, made.names, materials) if labelled else None,
        labels=coarse if labelled else None,
        names=made.names,
        phantom=made.phantom,
        undented=None if made.dent is None else _undented(made.dent, made.names, materials),
    )


def _undented(dent: PaintedDent, names: Mapping[int, str], materials: MaterialTable) -> Undented:
    def tissues() -> TissueMap:
        return TissueMap.named(dent.undented(MECHANICAL_VOXEL_MM).labels, names, materials)

    return Undented(dent.at, tissues, dent.undented)


def _labels(spec: SceneFile, folder: Path, progress: Progress) -> SceneContent:
    path = _needed_file(spec, folder)
    labels = read_labels(path, largest=LARGEST_ORGAN)
    progress(0.1)
    names = {0: BACKGROUND, **names_for(labels, path, _file(spec, folder, "names"))}
    ct = None if (file := _file(spec, folder, "ct")) is None else read_volume(file, name="ct")
    materials = scene_materials(spec, folder)
    with labels_named(path):
        phantom = phantom_from_organs(
            labels, {n: name for n, name in names.items() if n}, ct=ct, between=spec.tissue.between
        )
        tissues = TissueMap.named(labels, names, materials)
    progress(0.6)
    grid = _box(spec, labels)
    return SceneContent(
        grid=grid, see=_synthetic(spec, phantom), targets=_middle(grid), tissues=tissues, labels=labels, names=names,
        phantom=phantom,
    )  # fmt: skip


def _volume(spec: SceneFile, folder: Path, progress: Progress) -> SceneContent:
    path = _needed_file(spec, folder)
    volume = read_volume(path)
    warn_of_labels(volume, path, 'whose numbers are cut as grey levels; source = "labels" shows it as tissue')
    progress(0.3)
    seen = swept(volume)
    reslicer, grey = Reslicer(volume, seen=seen), grey_range(volume.voxels, seen)
    diameter = LOOKS[spec.needle.look]().diameter_mm
    grid = _box(spec, volume)
    return SceneContent(
        grid=grid, see=partial(ReslicedImager, reslicer, grey, needle_mm=diameter), targets=_middle(grid)
    )  # fmt: skip


def _synthetic(spec: SceneFile, phantom: Phantom) -> Callable[[Probe, Array], Imager]:
    view = view_of(spec, phantom)
    return partial(SyntheticImager.of, view.phantom, display=view.display, echo=view.echo, artefacts=view.artefacts)


def scene_materials(spec: SceneFile, folder: Path) -> MaterialTable:
    """Return the materials of a scene's tissues by name: its own before those of all scenes."""
    own = _file(spec, folder, "materials")
    with as_file(files(__package__).joinpath("scenes/materials.toml")) as path:
        table = MaterialTable.read(path)
    return table if own is None else table.preferring(MaterialTable.read(own).materials)


def _file(spec: SceneFile, folder: Path, key: str) -> Path | None:
    named = getattr(spec.tissue, key)
    return None if named is None else folder / named


def _needed_file(spec: SceneFile, folder: Path) -> Path:
    path = _file(spec, folder, "file")
    assert path is not None  # the scene file was checked for it
    return path


def _box(spec: SceneFile, volume: Volume) -> Grid:
    """The mechanical box: the whole image, or the part of it between two corners."""
    part, lattice = spec.tissue, volume.lattice
    low, high = np.zeros(3), lattice.extent
    if part.low is not None and part.high is not None:
        corners = lattice.local(np.array([part.low, part.high]))
        low, high = np.maximum(corners.min(axis=0), 0), np.minimum(corners.max(axis=0), lattice.extent)
        if (high - low < lattice.spacing).any():
            raise ValueError(f"tissue.low = {part.low} and high = {part.high} leave no box inside the image")
    origin = lattice.world(low[None])[0]
    return Grid.covering(high - low, nodes=part.nodes, origin=origin, direction=lattice.direction)


def _middle(grid: Grid) -> dict[str, Array]:
    return {"middle": grid.world(grid.extent[None] / 2)[0]}


def _coarser(labels: Volume) -> Volume:
    """The label map at about 2 mm: as fine as mechanics and surfaces need it."""
    strides = [max(1, round(MECHANICAL_VOXEL_MM / h)) for h in labels.spacing]
    voxels: NDArray[Any] = np.ascontiguousarray(labels.voxels[tuple(slice(None, None, s) for s in strides)])
    spacing = tuple(h * s for h, s in zip(labels.spacing, strides, strict=True))
    return replace(labels, voxels=voxels, spacing=spacing)  # type: ignore[arg-type]

"""A scene made ready: everything of it that does not change while a session runs; sessions share it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from ..geometry.tissue import Tissue
from ..geometry.volume import Volume
from ..io.labels import labels_named, names_of, read_labels, warn_of_labels
from ..io.volumes import read_volume
from ..mechanics.tissue_map import TissueMap
from ..mechanics.tissue_material import MaterialTable, read_label_names
from ..ultrasound.needle_echo import LOOKS, NeedleEcho
from ..ultrasound.organs import LARGEST_ORGAN, phantom_from_organs
from ..ultrasound.phantom import Phantom
from ..ultrasound.probe import PROBES, Probe
from ..ultrasound.reslice import Reslicer, swept
from ..ultrasound.synthesis import Display
from . import surfaces
from .command import Command
from .imaging import Imager, ReslicedImager, SyntheticImager, grey_range
from .knobs import Circumstances, Knobs, start
from .organs import organs
from .phantoms import PHANTOMS
from .scene_file import SceneFile, SurfacePart
from .skin_frame import SkinFrame
from .surfaces import MOST_VERTICES, Mesh

Array = NDArray[np.float64]
Progress = Callable[[float], None]

_MECHANICAL_VOXEL_MM = 2.0
_OWN_SURFACES = 8
_NETS = 2000
"""Vertices left for the skin and the grid lines."""
_COLOURS = ("#9c5247", "#b5483f", "#d8d4c6", "#d9b36c", "#7d8fa8", "#8aa37b", "#a889a8", "#b08968")


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A scene's tissue, what to see of it, where to go, and what may be asked."""

    spec: SceneFile
    tissue: Tissue
    frame: SkinFrame
    tissues: TissueMap | None
    """Labelled tissue for the elastic model; None where it is all one."""
    see: Callable[[Probe, Array], Imager]
    """What a probe at a pose sees."""
    probe: Probe
    targets: Mapping[str, Array]
    start: Command
    knobs: Knobs
    """What may be asked, and how far."""
    draw: Callable[[], tuple[Mesh, ...]]
    """Makes :attr:`meshes`."""
    prepare: Callable[[], None]
    """Makes what the first picture did not need and others will; from any thread."""

    @classmethod
    def make(cls, spec: SceneFile, *, folder: Path | None = None, progress: Progress | None = None) -> Scene:
        """Return a scene made ready.

        Parameters
        ----------
        spec : SceneFile
            The scene.
        folder : Path, optional
            Where its files are; by default here.
        progress : callable, optional
            Told the share done, 0 to 1.
        """
        return _Maker(spec, Path() if folder is None else folder, progress or (lambda share: None)).scene()

    @property
    def needle_diameter_mm(self) -> float:
        """Of its shaft."""
        return LOOKS[self.spec.needle.look]().diameter_mm

    def deformed(self, field: GridField, *, grid: bool) -> NDArray[np.float32]:
        """Return where a field takes the vertices of all meshes, with or without the grid lines, (m, 3)."""
        count = None if grid else -len(self.meshes[-1].points)
        rest = self._vertices[:count]
        return (rest + field.displacement(rest)).astype(np.float32)

    @cached_property
    def meshes(self) -> tuple[Mesh, ...]:
        """What the 3-D view is drawn of, the grid lines last; made when first asked for."""
        return self.draw()

    @cached_property
    def _vertices(self) -> Array:
        """Of all meshes, those of the grid lines last."""
        return np.concatenate([mesh.points for mesh in self.meshes])

    @property
    def box(self) -> tuple[Array, Array]:
        """Lowest and highest corner of the mechanical box along the world axes."""
        corners = self.tissue.grid.world(np.indices((2, 2, 2)).reshape(3, -1).T * self.tissue.grid.extent)
        return corners.min(axis=0), corners.max(axis=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Matter:
    """What a source gives: the lattice, labels for the eye and for mechanics, and how it looks."""

    grid: Grid
    see: Callable[[Probe, Array], Imager]
    targets: Mapping[str, Array]
    tissues: TissueMap | None = None
    labels: Volume | None = None
    names: Mapping[int, str] | None = None
    phantom: Phantom | None = None
    """What a synthetic picture is of."""


class _Maker:
    """Makes a scene ready from its file, step by step."""

    def __init__(self, spec: SceneFile, folder: Path, progress: Progress) -> None:
        self.spec, self.folder, self.progress = spec, folder, progress

    def scene(self) -> Scene:
        spec = self.spec
        self.progress(0.05)
        matter = {"labels": self._labels, "volume": self._volume}.get(spec.tissue.source, self._phantom)()
        self.progress(0.7)
        tissue = Tissue(matter.grid, entry_face=spec.tissue.entry_face)
        frame = SkinFrame.on_face(matter.grid, spec.tissue.entry_face, at=spec.probe.at, right=spec.probe.right)
        probe = _probe(spec)
        targets = {part.name: np.array(part.at) for part in spec.targets} or dict(matter.targets)
        tissue.check_inside(**{f"target {name!r}": at for name, at in targets.items()})
        along, across = frame.sides(matter.grid)
        circumstances = Circumstances(spec, probe, along, across, synthetic=matter.phantom is not None)
        knobs, first = Knobs.of(Command, circumstances), start(Command, circumstances)
        knobs.check(first)
        self.progress(0.9)
        return Scene(
            spec=spec, tissue=tissue, frame=frame, tissues=matter.tissues, see=matter.see, probe=probe,
            targets=targets, start=first, knobs=knobs,
            draw=partial(_meshes, spec, matter, frame),
            prepare=_nothing if matter.phantom is None else matter.phantom.prepare,
        )  # fmt: skip

    def _phantom(self) -> _Matter:
        made = PHANTOMS[self.spec.tissue.source](self.spec.tissue.voxel_mm)
        self.progress(0.5)
        low, high = made.box
        grid = Grid.covering(high - low, nodes=self.spec.tissue.nodes, origin=low)
        coarse = _coarser(made.phantom.labels)
        tissues = None if made.homogeneous else TissueMap.named(coarse, made.names, self._materials())
        return _Matter(
            grid=grid, see=self._synthetic(made.phantom), targets=made.targets, tissues=tissues,
            labels=None if made.homogeneous else coarse, names=made.names, phantom=made.phantom,
        )  # fmt: skip

    def _labels(self) -> _Matter:
        path = self._file("file")
        assert path is not None
        labels = read_labels(path, largest=LARGEST_ORGAN)
        self.progress(0.1)
        names = read_label_names(names_of(path, self._file("names")))
        ct = None if (file := self._file("ct")) is None else read_volume(file, name="ct")
        materials = self._materials()
        with labels_named(path):
            phantom = phantom_from_organs(labels, {n: name for n, name in names.items() if n}, ct=ct)
            tissues = TissueMap.named(labels, names, materials)
        self.progress(0.6)
        grid = self._box(labels)
        return _Matter(
            grid=grid,
            see=self._synthetic(phantom),
            targets=_middle(grid),
            tissues=tissues,
            labels=labels,
            names=names,
            phantom=phantom,
        )

    def _volume(self) -> _Matter:
        path = self._file("file")
        assert path is not None
        volume = read_volume(path)
        warn_of_labels(volume, path, 'whose numbers are cut as grey levels; source = "labels" shows it as tissue')
        self.progress(0.3)
        seen = swept(volume)
        reslicer = Reslicer(volume, seen=seen)
        grey, diameter = grey_range(volume.voxels, seen), self._echo().diameter_mm
        grid = self._box(volume)
        return _Matter(
            grid=grid, see=partial(ReslicedImager, reslicer, grey, needle_mm=diameter),
            targets=_middle(grid),
        )  # fmt: skip

    def _synthetic(self, phantom: Phantom) -> Callable[[Probe, Array], Imager]:
        shown = self.spec.display
        display = Display(gain_db=Display().gain_db + shown.gain_db, range_db=shown.range_db)
        echo = self._echo()
        return partial(SyntheticImager.of, phantom, display=display, echo=echo)

    def _echo(self) -> NeedleEcho:
        return LOOKS[self.spec.needle.look]()

    def _materials(self) -> MaterialTable:
        own = self._file("materials")
        with as_file(files(__package__).joinpath("scenes/materials.toml")) as path:
            table = MaterialTable.read(path)
        return table if own is None else table.preferring(MaterialTable.read(own).materials)

    def _file(self, key: str) -> Path | None:
        named = getattr(self.spec.tissue, key)
        return None if named is None else self.folder / named

    def _box(self, volume: Volume) -> Grid:
        """The mechanical box: the whole image, or the part of it between two corners."""
        part, lattice = self.spec.tissue, volume.lattice
        low, high = np.zeros(3), lattice.extent
        if part.low is not None and part.high is not None:
            corners = lattice.local(np.array([part.low, part.high]))
            low, high = np.maximum(corners.min(axis=0), 0), np.minimum(corners.max(axis=0), lattice.extent)
            if (high - low < lattice.spacing).any():
                raise ValueError(f"tissue.low = {part.low} and high = {part.high} leave no box inside the image")
        origin = lattice.world(low[None])[0]
        return Grid.covering(high - low, nodes=part.nodes, origin=origin, direction=lattice.direction)


def _nothing() -> None:
    pass


def _meshes(spec: SceneFile, matter: _Matter, frame: SkinFrame) -> tuple[Mesh, ...]:
    nets = surfaces.skin(matter.grid, spec.tissue.entry_face, frame), surfaces.grid_lines(matter.grid, frame)
    if matter.labels is None or matter.names is None:
        return nets
    parts = spec.surfaces or _own_surfaces(matter.labels, matter.names)
    if not parts:
        return nets
    return *organs(matter.labels, matter.names, parts, most=(MOST_VERTICES - _NETS) // len(parts)), *nets


def _probe(spec: SceneFile) -> Probe:
    part = spec.probe
    focus = {} if part.focus_mm is None else {"elevation_focus_mm": part.focus_mm}
    return PROBES[part.kind](frequency_mhz=part.frequency_mhz, depth_mm=part.depth_mm, lines=part.lines, **focus)


def _middle(grid: Grid) -> dict[str, Array]:
    return {"middle": grid.world(grid.extent[None] / 2)[0]}


def _coarser(labels: Volume) -> Volume:
    """The label map at about 2 mm: as fine as mechanics and surfaces need it."""
    strides = [max(1, round(_MECHANICAL_VOXEL_MM / h)) for h in labels.spacing]
    voxels: NDArray[Any] = np.ascontiguousarray(labels.voxels[tuple(slice(None, None, s) for s in strides)])
    spacing = tuple(h * s for h, s in zip(labels.spacing, strides, strict=True))
    return replace(labels, voxels=voxels, spacing=spacing)  # type: ignore[arg-type]


def _own_surfaces(labels: Volume, names: Mapping[int, str]) -> list[SurfacePart]:
    """The largest organs of a label map that comes without a list of them."""
    numbers, counts = np.unique(labels.voxels, return_counts=True)
    order = [int(n) for n in numbers[np.argsort(-counts)] if n and int(n) in names]
    return [
        SurfacePart(name=names[n], tissues=(names[n],), colour=_COLOURS[k], opacity=0.7)
        for k, n in enumerate(order[:_OWN_SURFACES])
    ]

"""Where anatomies come from: drawn blocks, scenes, and label maps of a folder."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace as changed
from numpy.random import Generator

from .._digest import digest
from ..geometry.grid import Grid
from ..geometry.volume import Volume
from ..io.records import FieldError
from ..mechanics.material import Material
from ..mechanics.membranes import Membrane
from ..phantoms.drawn_block import BLOCK_MM, NAMES, VOXEL_MM, Block, acoustic_tissue
from ..simulator.scene_content import SceneContent, read_content, scene_materials
from ..simulator.scene_file import NeedlePart, ProbePart, SceneFile, TissuePart
from ..simulator.skin_frame import SkinFrame
from ..ultrasound.acoustics import TISSUES, AcousticTissue
from .draws import Array
from .source_files import hash_of
from .specification import SourcePart, Specification
from .warp import Warp

_VOXEL_MM = 1.0
_KEPT = 4
"""Sources that a process keeps between anatomies."""
_BLOCK_SCENE = SceneFile(
    name="Drawn block",
    description="Layers over liver, with vessels and a tumour",
    tissue=TissuePart(source="gel block", nodes=20_000),
    needle=NeedlePart(length_mm=120.0),
    probe=ProbePart(
        kind="linear", name="L12-4 linear", frequency_mhz=7.5, depth_mm=50.0, focus_mm=25.0, right=(1.0, 0.0, 0.0)
    ),
)
"""How a block is seen; what it is made of is drawn."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Painted:
    """An anatomy as labels: for the eye, and for mechanics where it is not all one."""

    acoustic: Volume
    mechanical: Volume | None


class Form(ABC):
    """The shape of one anatomy."""

    targets: Mapping[str, Array]

    @abstractmethod
    def paint(self) -> Painted:
        """Make its labels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Source(ABC):
    """Where anatomies come from, read once.

    Parameters
    ----------
    scene : SceneFile
        How it is seen: skin, probe, needle, materials.
    hash : str
        Of all that it is made of.
    grid : Grid
        The box and its display grid.
    tissues : mapping of int to AcousticTissue
        By label for the eye.
    names : mapping of int to str
        Names of those labels.
    materials : mapping of int to Material
        By label for mechanics; empty where tissue is all one.
    """

    scene: SceneFile
    hash: str
    grid: Grid
    tissues: Mapping[int, AcousticTissue]
    names: Mapping[int, str]
    materials: Mapping[int, Material]
    membranes: tuple[Membrane, ...] = ()

    @property
    def frame(self) -> SkinFrame:
        """Directions of its skin, from the middle of the face."""
        return SkinFrame.on_face(self.grid, self.scene.tissue.entry_face, at=None, right=self.scene.probe.right)

    @property
    def press_mm(self) -> float:
        """How deep the probe is pressed in."""
        return self.scene.probe.press_mm

    @abstractmethod
    def drawn(self, random: Generator, asked: Specification) -> Form:
        """Draw the shape of an anatomy."""


class _DrawnBlock(Form):
    def __init__(self, block: Block, voxel_mm: float) -> None:
        self.block, self.targets, self._voxel_mm = block, block.targets, voxel_mm

    def paint(self) -> Painted:
        labels = self.block.labels(self._voxel_mm)
        return Painted(acoustic=labels, mechanical=labels)


class BlockSource(Source):
    """Blocks that are drawn."""

    def drawn(self, random: Generator, asked: Specification) -> Form:
        return _DrawnBlock(Block.drawn(random), asked.anatomy.voxel_mm or VOXEL_MM)

    @classmethod
    def made(cls) -> BlockSource:
        """Return the source of blocks."""
        table = scene_materials(_BLOCK_SCENE, Path())
        tissues = {n: acoustic_tissue(name) for n, name in NAMES.items()}
        return cls(
            scene=_BLOCK_SCENE, hash=digest("block", 1), grid=Grid.covering(BLOCK_MM, nodes=_BLOCK_SCENE.tissue.nodes),
            tissues={0: TISSUES["gel"], **tissues}, names={0: "gel", **NAMES},
            materials={n: table[name] for n, name in NAMES.items()},
        )  # fmt: skip


class _Warped(Form):
    def __init__(self, source: WarpedSource, warp: Warp) -> None:
        self._source, self._warp = source, warp
        self.targets = {name: warp.anatomy_of(at) for name, at in source.targets.items()}

    def paint(self) -> Painted:
        labels = self._source.mechanical
        return Painted(
            acoustic=self._warp.labels(self._source.acoustic),
            mechanical=None if labels is None else self._warp.labels(labels),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class WarpedSource(Source):
    """A scene or a label map, of which every anatomy is a warped one."""

    acoustic: Volume
    mechanical: Volume | None
    targets: Mapping[str, Array]
    dented: bool = False
    """Whether the scene's own dent of a probe was left out."""

    @property
    def press_mm(self) -> float:
        return 0.0 if self.dented else self.scene.probe.press_mm

    def drawn(self, random: Generator, asked: Specification) -> Form:
        return _Warped(self, Warp.drawn(random, asked.anatomy, self.frame, self.grid))

    @classmethod
    def of(cls, scene: SceneFile, folder: Path, hash: str) -> WarpedSource:
        """Return the source of a scene, its files seen from a folder; the hash is theirs together."""
        content = read_content(scene, folder, lambda share: None)
        if content.phantom is None:
            raise ValueError(f"scene {scene.name!r} is a real image, which has no labels; give labels or a phantom")
        undented = _undented(scene, content)
        phantom = undented.phantom or content.phantom
        tissues = undented.tissues
        own = {part.name: np.array(part.at) for part in scene.targets}
        named = dict(content.names or {})
        return cls(
            scene=scene, hash=hash, grid=content.grid,
            tissues=phantom.tissues,
            names={n: named.get(n) or tissue.name for n, tissue in phantom.tissues.items()},
            materials={} if tissues is None else tissues.materials,
            membranes=() if tissues is None else tissues.membranes,
            acoustic=phantom.labels, mechanical=None if tissues is None else tissues.labels,
            targets=own or dict(content.targets), dented=content.undented is not None,
        )  # fmt: skip


def _undented(scene: SceneFile, content: SceneContent) -> SceneContent:
    """A phantom without the dent it is painted with: probes of a data set are elsewhere."""
    if content.undented is None:
        return content
    phantom, tissues = content.undented.phantom(scene.tissue.voxel_mm), content.undented.tissues()
    membranes = () if content.tissues is None else content.tissues.membranes
    return replace(content, phantom=phantom, tissues=replace(tissues, membranes=membranes))


class Origin(msgspec.Struct, frozen=True):
    """One source that anatomies are drawn from: a part of the specification, or one of its folder's files."""

    part: int
    file: str | None
    weight: float


def origins(asked: Specification) -> tuple[Origin, ...]:
    """Return every source of a specification, those of a folder by the names of its files.

    Raises
    ------
    ValueError
        A folder that is not there, or that holds none of the label maps.
    """
    found: list[Origin] = []
    for number, part in enumerate(asked.sources):
        if part.kind != "labels":
            found.append(Origin(number, None, part.weight))
            continue
        files = _label_maps(asked, part)
        found += [Origin(number, str(file), part.weight / len(files)) for file in files]
    return tuple(origin for origin in found if origin.weight > 0)


def _label_maps(asked: Specification, part: SourcePart) -> list[Path]:
    folder = asked.folder / str(part.folder)
    if not folder.is_dir():
        raise ValueError(f"folder = {part.folder!r} of the sources is not there; give a folder of label maps")
    files = sorted(file for file in folder.glob(part.pattern) if file.is_file())
    if not files:
        raise ValueError(f"folder = {part.folder!r} holds no {part.pattern}; give a folder of label maps")
    return files


def source(asked: Specification, origin: Origin) -> Source:
    """Return a source, kept in this process where the same was read before: its files may have changed meanwhile.

    Raises
    ------
    ValueError
        A scene or label map that cannot be read.
    """
    part, look = asked.sources[origin.part], asked.needle.look
    if part.kind == "block":
        made = BlockSource.made()
        return made if look is None else replace(made, scene=_looking(made.scene, look))
    scene, beside = scene_of(asked, origin)
    return _read(scene, beside, hash_of(scene, beside))


@lru_cache(maxsize=_KEPT)
def _read(scene: SceneFile, folder: Path, hash: str) -> Source:
    return WarpedSource.of(scene, folder, hash)


def scene_of(asked: Specification, origin: Origin) -> tuple[SceneFile, Path]:
    """Return the scene that a source other than blocks is read by, and the folder that its files are seen from."""
    part = asked.sources[origin.part]
    scene, beside = _scene(str(part.scene), asked.folder)
    tissue = changed(scene.tissue, voxel_mm=asked.anatomy.voxel_mm or _VOXEL_MM)
    if origin.file is not None:
        if tissue.source != "labels":
            raise ValueError(f"scene = {part.scene!r} is no scene of labels; give one with source = 'labels'")
        tissue = changed(tissue, file=origin.file)
    scene = changed(scene, tissue=tissue)
    return (scene if asked.needle.look is None else _looking(scene, asked.needle.look)), beside


def _looking(scene: SceneFile, look: str) -> SceneFile:
    return changed(scene, needle=changed(scene.needle, look=look))


def _scene(named: str, folder: Path) -> tuple[SceneFile, Path]:
    if not named.endswith(".toml"):
        return SceneFile.shipped(named), Path()
    path = folder / named
    try:
        return SceneFile.read(path), path.parent
    except FieldError as error:
        raise ValueError(f"scene = {named!r}: {error}") from None

"""What a data set holds, as TOML: where anatomy comes from, ranges of everything that is drawn, and what is kept."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from .._digest import digest
from ..io.files import read_text
from ..io.records import LONGEST_LIST, FieldError, Record, Text, about, read, schema
from ..simulator.model_part import ModelPart
from ..simulator.scene_file import Look, parsed
from ..simulator.shipped import SHIPPED

Names = Annotated[tuple[Text, ...], Meta(max_length=LONGEST_LIST)]
"""Patterns of names; * stands for anything."""
Factor = Annotated[float, about("", 0.05, 20.0)]
Decibel = Annotated[float, about("", -200.0, 60.0)]
Millimetre = Annotated[float, about("", -200.0, 200.0)]
Length = Annotated[float, about("", 0.0, 300.0)]
Turn = Annotated[float, about("", -180.0, 180.0)]
Tilt = Annotated[float, about("", -60.0, 60.0)]
Slope = Annotated[float, about("", 5.0, 90.0)]
Share = Annotated[float, about("", 0.02, 1.0)]
Megahertz = Annotated[float, about("", 1.0, 20.0)]

LARGEST_SEED = 2**63 - 1


class Ranges(Record, frozen=True, kw_only=True):
    """A table of ranges ``[low, high]``, ends included; two equal ends are a fixed value."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            match getattr(self, name):
                case (int() | float() as low, int() | float() as high) if low > high:
                    raise FieldError((name,), f"= [{low:g}, {high:g}] is empty; give [low, high], low first")


class SourcePart(Record, frozen=True, kw_only=True):
    """Where anatomies come from."""

    kind: Annotated[
        Literal["block", "scene", "labels"],
        about("a block of tissue that is drawn, a scene, or every label map of a folder"),
    ]
    scene: (
        Annotated[Text, about("name of a shipped scene or a scene file; of labels, what they are seen with")] | None
    ) = None
    folder: Annotated[Text, about("of the label maps")] | None = None
    pattern: Annotated[Text, about("which of its files")] = "*.nii.gz"
    weight: Annotated[float, about("share of the anatomies, over those of the others", 0.0, 1e6)] = 1.0

    def __post_init__(self) -> None:
        if self.kind == "scene" and self.scene is None:
            raise FieldError(("scene",), f"is missing; give {', '.join(SHIPPED)} or a scene file")
        if self.kind == "labels" and (self.folder is None or self.scene is None):
            missing = "folder" if self.folder is None else "scene"
            raise FieldError((missing,), "is missing; labels have a folder and a scene file that they are seen with")
        if self.kind == "block" and (self.scene or self.folder):
            raise FieldError(("scene" if self.scene else "folder",), "is not for a block, which is drawn; leave it out")


class AnatomyPart(Ranges, frozen=True, kw_only=True):
    """How anatomies differ; one is shared by a run of samples."""

    samples: Annotated[int, about("samples of one anatomy", 1, 100_000)] = 256
    voxel_mm: (
        Annotated[float, about("voxel of generated tissue; by default 0.7 of blocks, 1 of scenes", 0.2, 4.0)] | None
    ) = None
    scale: Annotated[tuple[Factor, Factor], about("stretch along each axis; not of blocks")] = (0.92, 1.08)
    warp_mm: Annotated[tuple[Length, Length], about("largest displacement of a smooth warp; not of blocks")] = (
        0.0,
        3.0,
    )
    stiffness: Annotated[tuple[Factor, Factor], about("factor of each tissue's stiffness")] = (0.7, 1.4)
    backscatter_db: Annotated[tuple[Decibel, Decibel], about("added to each tissue's level")] = (-2.0, 2.0)
    attenuation: Annotated[tuple[Factor, Factor], about("factor of each tissue's attenuation")] = (0.85, 1.2)


class ViewPart(Ranges, frozen=True, kw_only=True):
    """Where the probe is; it stays there for a run of samples."""

    samples: Annotated[int, about("samples while the probe rests", 1, 100_000)] = 32
    slide_mm: Annotated[tuple[Millimetre, Millimetre], about("of the image's middle beside the target")] = (-5.0, 5.0)
    sweep_mm: Annotated[tuple[Millimetre, Millimetre], about("of the image plane off the target")] = (-1.0, 1.0)
    rotate_deg: Annotated[tuple[Turn, Turn], about("about the way down")] = (-15.0, 15.0)
    fan_deg: Annotated[tuple[Tilt, Tilt], about("of the image plane from the way down")] = (0.0, 0.0)
    frequency_mhz: Annotated[tuple[Megahertz, Megahertz], about("of each anatomy; by default the scene's")] | None = (
        None
    )
    depth_mm: Annotated[tuple[Length, Length], about("of the image of each anatomy; by default the scene's")] | None = (
        None
    )
    lines: Annotated[int, about("beams of the probe", 32, 512)] = 128
    gain_db: Annotated[tuple[Decibel, Decibel], about("added to the scene's gain, of each sample")] = (-3.0, 3.0)
    noise_db: Annotated[tuple[Decibel, Decibel], about("electronic noise, of each sample")] = (-76.0, -64.0)


class TargetPart(Ranges, frozen=True, kw_only=True):
    """What needles are aimed at."""

    names: Annotated[Names, about("targets of the scene; by default all")] = ()
    tissues: Annotated[Names, about("tissues to draw a place in, instead of the scene's targets")] = ()
    off_mm: Annotated[tuple[Length, Length], about("of the needle's aim beside the target")] = (0.0, 4.0)


class NeedlePart(Ranges, frozen=True, kw_only=True):
    """How needles go in."""

    look: Annotated[Look, about("how it looks; by default as the scene has it")] | None = None
    angle_deg: Annotated[tuple[Slope, Slope], about("to the skin, in the image plane")] = (25.0, 65.0)
    swing_deg: Annotated[tuple[Tilt, Tilt], about("out of the image plane")] = (-4.0, 4.0)
    sides: Annotated[Literal["left", "right", "both"], about("of the image it comes from")] = "both"
    reach: Annotated[tuple[Share, Share], about("of the way to the target that the tip has gone")] = (0.4, 1.0)
    steps: Annotated[int, about("of the way, where contact is a track", 1, 200)] = 12
    speed_mm_s: Annotated[tuple[Factor, Factor], about("of the tip, where contact is a track")] = (5.0, 15.0)


class StoredPart(Record, frozen=True, kw_only=True):
    """What is kept of each sample, beside its row in the table."""

    pixels: Annotated[int, about("rows and columns of the image", 32, 1024)] = 256
    image: Annotated[bool, about("the B-mode image")] = True
    labels: Annotated[bool, about("tissue at each pixel, as it lies now")] = True
    needle: Annotated[bool, about("pixels where the slice shows the needle")] = True
    displacement: Annotated[bool, about("of the tissue now at each place of the image, mm")] = True
    stride: Annotated[int, about("pixels between those places", 1, 32)] = 4
    volume: Annotated[
        int, about("nodes along each side of the box at which displacement is kept; 0 for none", 0, 129)
    ] = 0
    iq: Annotated[bool, about("complex echoes before compression, over liver's speckle: 4 bytes a sample")] = False

    def __post_init__(self) -> None:
        if self.pixels % self.stride:
            raise FieldError(("stride",), f"= {self.stride} does not divide pixels = {self.pixels}; give a divisor")
        if self.volume == 1:
            raise FieldError(("volume",), "= 1 is no lattice; give 2 or more nodes along each side, or 0")


class SplitPart(Record, frozen=True, kw_only=True):
    """Shares of the anatomies, or of label maps; all samples of one are in one split."""

    train: Annotated[float, about("to learn from", 0.0, 1.0)] = 0.8
    validation: Annotated[float, about("to choose by", 0.0, 1.0)] = 0.1
    test: Annotated[float, about("to be judged by", 0.0, 1.0)] = 0.1

    def __post_init__(self) -> None:
        if abs(self.train + self.validation + self.test - 1) > 1e-6:
            total = self.train + self.validation + self.test
            raise FieldError(("train",), f"+ validation + test = {total:g}; give shares that add up to 1")


class StoragePart(Record, frozen=True, kw_only=True):
    """How it is stored."""

    form: Annotated[
        Literal["zarr", "webdataset", "recipe"],
        about("Zarr 3 arrays, tar files for WebDataset, or a table of recipes that samples are made from again"),
    ] = "zarr"
    shard: Annotated[int, about("samples in a file; by default those of an anatomy", 1, 100_000)] | None = None
    names_of_files: Annotated[bool, about("whether the manifest names label maps by their hashes")] = False


class Specification(Record, frozen=True, kw_only=True, dict=True):
    """A data set, as it is written.

    Examples
    --------
    >>> from sonospline.dataset import Specification
    >>> asked = Specification.parse('''samples = 512
    ... [[sources]]
    ... kind = "block"
    ... ''')
    >>> asked.anatomies, asked.needle.angle_deg
    (2, (25.0, 65.0))
    """

    name: Annotated[Text, about("what to call it")] = "needles"
    description: Annotated[Text, about("one line about it")] = ""
    licence: Annotated[Text, about("under which it is handed on, an SPDX name")] = "unstated"
    samples: Annotated[int, about("how many", 1, 10**9)]
    seed: Annotated[int, about("of everything that is drawn", 0, LARGEST_SEED)] = 0
    sources: Annotated[tuple[SourcePart, ...], about("of anatomies", longest=LONGEST_LIST)]
    anatomy: Annotated[AnatomyPart, about("how anatomies differ")] = AnatomyPart()
    view: Annotated[ViewPart, about("where the probe is, and its settings")] = ViewPart()
    target: Annotated[TargetPart, about("what needles are aimed at")] = TargetPart()
    needle: Annotated[NeedlePart, about("how they go in")] = NeedlePart()
    model: Annotated[ModelPart, about("how tissue answers")] = ModelPart(solver_nodes=15_625)  # type: ignore[call-arg]
    stored: Annotated[StoredPart, about("what is kept")] = StoredPart()
    split: Annotated[SplitPart, about("shares of anatomies")] = SplitPart()
    storage: Annotated[StoragePart, about("how it is stored")] = StoragePart()

    def __post_init__(self) -> None:
        if not self.sources or not any(source.weight for source in self.sources):
            raise FieldError(("sources",), "has none of any weight; give at least one")
        if self.anatomy.samples % self.view.samples:
            raise FieldError(
                ("view", "samples"),
                f"= {self.view.samples} does not divide anatomy.samples = {self.anatomy.samples}; give a divisor",
            )

    @classmethod
    def parse(cls, text: str, *, file: str = "specification") -> Specification:
        """Return the specification that a TOML text is.

        Raises
        ------
        ValueError
            Not TOML, an unknown or missing key, a value out of range, an empty range; it knows the line.
        """
        return parsed(cls, text, file)

    @classmethod
    def parse_table(cls, table: dict[str, Any]) -> Specification:
        """Return the specification that a table is, as :meth:`as_table` gives it."""
        return read(cls, table)

    @classmethod
    def read(cls, path: str | Path) -> Specification:
        """Read a specification; files that it names are seen from its folder."""
        asked = cls.parse(read_text(path, "specification", "a TOML file"), file=Path(path).name)
        return asked.seen_from(Path(path).resolve().parent)

    @cached_property
    def folder(self) -> Path:
        """Where the files it names are seen from."""
        return Path.cwd()

    def seen_from(self, folder: Path) -> Specification:
        """Return the same, the files that it names seen from a folder."""
        return _seen_from(folder, {name: getattr(self, name) for name in self.__struct_fields__})

    def __reduce__(self) -> tuple[Any, ...]:
        return _seen_from, (self.folder, {name: getattr(self, name) for name in self.__struct_fields__})

    @property
    def anatomies(self) -> int:
        """How many anatomies there are."""
        return -(-self.samples // self.anatomy.samples)

    @property
    def shard(self) -> int:
        """Samples in a file."""
        return self.storage.shard or self.anatomy.samples

    @property
    def shards(self) -> int:
        """How many files there are, of each kind."""
        return -(-self.samples // self.shard)

    def as_table(self) -> dict[str, Any]:
        """Return all of it as JSON and TOML hold it."""
        found: dict[str, Any] = msgspec.to_builtins(self)
        return found

    @cached_property
    def digest(self) -> str:
        """A short text that equal specifications share, wherever their files are."""
        return digest(msgspec.json.encode(self, order="sorted").decode())


def _seen_from(folder: Path, held: dict[str, Any]) -> Specification:
    asked = Specification(**held)
    asked.__dict__["folder"] = folder
    return asked


def specification_schema() -> dict[str, Any]:
    """Return the JSON schema of specifications."""
    top = {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema(Specification)}
    return {**top, "title": "Sonospline data set"}

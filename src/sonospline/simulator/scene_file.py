"""Scene files: what is simulated, as TOML."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from ..io.files import read_text
from ..io.toml_text import TomlError, loads
from ._fields import FieldError, read, schema, told

Triple = tuple[float, float, float]
Source = Literal["kidney", "gel block", "cube", "labels", "volume"]
Face = Literal["x-", "x+", "y-", "y+", "z-", "z+"]
ModelName = Literal["paper", "kelvinlet", "elastic"]

MODELS: dict[str, str] = {"paper": "Paper spline", "kelvinlet": "Kelvinlet", "elastic": "Elastic"}
LONGEST = 64 * 1024
"""Characters of a scene file."""
SHIPPED = ("kidney", "gel", "cube")


@dataclass(frozen=True, kw_only=True)
class TissuePart:
    """What the tissue is."""

    source: Source = told("a generated phantom, a label map, or a real 3-D image")
    file: str | None = told("label map or image, seen from the scene file", default=None)
    names: str | None = told("CSV of label, name; by default the .csv beside the label map", default=None)
    ct: str | None = told("CT of the same patient, for voxels without a label", default=None)
    materials: str | None = told("TOML of materials by name; others are the assumed ones", default=None)
    stiffness_kpa: float = told("Young's modulus where there are no labels", low=1e-3, high=1e6, default=10.0)
    voxel_mm: float = told("voxel of a generated phantom", low=0.2, high=4.0, default=0.5)
    entry_face: Face = told("the free face, lattice axis and side; the other five are pinned", default="z-")
    low: Triple | None = told("one corner of the mechanical box, RAS mm; by default the whole image", default=None)
    high: Triple | None = told("the opposite corner", default=None)
    nodes: int = told("nodes of the display grid, about", low=1000, high=500_000, default=40_000)


@dataclass(frozen=True, kw_only=True)
class ModelPart:
    """How the tissue answers."""

    use: ModelName = told("the model at the start", default="elastic")
    solver_nodes: int = told("nodes of the elastic solver, about", low=1000, high=200_000, default=15_625)
    drag_mm: float | None = told("displacement at the shaft, Kelvinlet", low=0.0, high=50.0, default=None)
    poissons_ratio: float = told("of homogeneous tissue", low=0.0, high=0.49, default=0.45)


@dataclass(frozen=True, kw_only=True)
class NeedlePart:
    """The needle and where it starts."""

    look: Literal["trocar", "echogenic-2mm", "steel-2mm", "steel-1mm"] = told("how it looks", default="trocar")
    length_mm: float = told("length from hub to tip", low=10.0, high=400.0, default=150.0)
    u: float | None = told("entry to the right of the probe's place, mm; half way to the edge by default", low=-500.0,
                           high=500.0, default=None)  # fmt: skip
    v: float = told("entry away from the viewer, mm", low=-500.0, high=500.0, default=0.0)
    angle: float = told("to the right 0, straight down 90, to the left 180 degrees", low=5.0, high=175.0, default=120.0)
    swing: float = told("out of the image plane, degrees", low=-60.0, high=60.0, default=0.0)


@dataclass(frozen=True, kw_only=True)
class ProbePart:
    """The probe and its rest pose."""

    kind: Literal["curvilinear", "linear", "phased"] = told("its beams", default="curvilinear")
    name: str = told("what to call it", default="C5-2 curved")
    frequency_mhz: float = told("centre frequency", low=1.0, high=20.0, default=3.5)
    depth_mm: float = told("depth of the image", low=20.0, high=250.0, default=120.0)
    focus_mm: float | None = told("depth where the slice is thinnest; by default as the kind", low=5.0, high=250.0,
                                  default=None)  # fmt: skip
    lines: int = told("beams", low=16, high=512, default=192)
    at: Triple | None = told("point of the skin it rests on, RAS mm; the middle of the face by default", default=None)
    right: Triple | None = told("world direction to the right in the image; along the face's longer side by default",
                                 default=None)  # fmt: skip
    press_mm: float = told("how deep it is pressed in", low=0.0, high=30.0, default=0.0)
    slide: float = told("where it starts, mm to the right of its place", low=-300.0, high=300.0, default=0.0)


@dataclass(frozen=True, kw_only=True)
class TargetPart:
    """A place to reach."""

    name: str = told("what to call it")
    at: Triple = told("where it is in undeformed tissue, RAS mm")


@dataclass(frozen=True, kw_only=True)
class DisplayPart:
    """The picture's grey levels, and when a target counts as reached."""

    gain_db: float = told("added to the scanner's own gain", low=-60.0, high=60.0, default=0.0)
    range_db: float = told("black to white", low=20.0, high=100.0, default=60.0)
    tolerance_mm: float = told("tip to target that counts as on target", low=0.1, high=50.0, default=3.0)


@dataclass(frozen=True, kw_only=True)
class SurfacePart:
    """One organ of the 3-D view."""

    name: str = told("what to call it")
    tissues: tuple[str, ...] = told("names of the labels it is made of; * stands for anything")
    colour: str = told("#rrggbb")
    opacity: float = told("0 to 1", low=0.0, high=1.0, default=1.0)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", self.colour):
            raise FieldError(("colour",), f"= {self.colour!r} is no colour; give #rrggbb")


@dataclass(frozen=True, kw_only=True)
class SceneFile:
    """A scene, as it is written.

    Examples
    --------
    >>> from sonospline.simulator import SceneFile
    >>> scene = SceneFile.parse('''name = "Block"
    ... [tissue]
    ... source = "gel block"
    ... ''')
    >>> scene.model.use, scene.tissue.entry_face
    ('elastic', 'z-')
    """

    name: str = told("what to call it")
    description: str = told("one line about it", default="")
    tissue: TissuePart = told("what the tissue is")
    model: ModelPart = told("how it answers", default=ModelPart())
    needle: NeedlePart = told("the needle", default=NeedlePart())
    probe: ProbePart = told("the probe", default=ProbePart())
    targets: tuple[TargetPart, ...] = told("places to reach; the phantoms have their own", default=())
    display: DisplayPart = told("grey levels and tolerance", default=DisplayPart())
    surfaces: tuple[SurfacePart, ...] = told("organs of the 3-D view", default=())

    def __post_init__(self) -> None:
        if self.tissue.source in ("labels", "volume") and self.tissue.file is None:
            raise FieldError(("tissue", "file"), f"is missing; give the file of source = {self.tissue.source!r}")
        if (self.tissue.low is None) != (self.tissue.high is None):
            raise FieldError(("tissue", "low"), "and high belong together; give both corners or neither")

    @classmethod
    def parse(cls, text: str, *, file: str = "scene") -> SceneFile:
        """Return the scene a text describes.

        Raises
        ------
        SceneError
            Not TOML, an unknown or missing key, or a value out of range; it knows the line.
        """
        if len(text) > LONGEST:
            raise SceneError(file, None, f"has {len(text)} characters; give at most {LONGEST}")
        try:
            return read(cls, loads(text))
        except TomlError as error:
            raise SceneError(file, error.line, f"is not TOML: {error.problem}") from None
        except FieldError as error:
            raise SceneError(file, line_of(text, error.path), str(error)) from None

    @classmethod
    def read(cls, path: str | Path) -> SceneFile:
        """Read a scene file."""
        return cls.parse(read_text(path, "scene", "a TOML file"), file=Path(path).name)

    @classmethod
    def shipped(cls, name: str) -> SceneFile:
        """Return a scene that comes with the package: ``kidney``, ``gel`` or ``cube``."""
        if name not in SHIPPED:
            raise ValueError(f"scene = {name!r} is not known; choose one of {', '.join(SHIPPED)}, or give a .toml file")
        return cls.parse(files(__package__).joinpath(f"scenes/{name}.toml").read_text(), file=f"{name}.toml")


class SceneError(ValueError):
    """A scene file that cannot be used: which file, which line, what is wrong and what would be right."""

    def __init__(self, file: str, line: int | None, problem: str) -> None:
        self.file, self.line, self.problem = file, line, problem
        super().__init__(f"{file}, line {line}: {problem}" if line else f"{file}: {problem}")


def scene_schema() -> dict[str, Any]:
    """Return the JSON schema of scene files."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Sonospline scene"} | schema(SceneFile)


def line_of(text: str, path: tuple[str | int, ...]) -> int | None:
    """Return the line (from 1) of a TOML text where a value stands, or the table that lacks it."""
    tables = [step for step in path[:-1] if isinstance(step, str)]
    wanted = [step for step in path if isinstance(step, int)][:1]
    here: list[str] = []
    seen: dict[str, int] = {}
    found: int | None = None
    for number, line in enumerate(text.split("\n"), 1):
        header = re.match(r"\s*\[\[?\s*([\w.-]+)\s*\]\]?", line)
        if header:
            here = header[1].split(".")
            seen[header[1]] = seen.get(header[1], -1) + 1
        at_home = not wanted or seen.get(".".join(here), 0) == wanted[0]
        if header and here == [s for s in path if isinstance(s, str)] and at_home:
            return number
        if here[: len(tables)] == tables and at_home:
            if header or found is None:
                found = number if header else found
            if path and re.match(rf"\s*[\"']?{re.escape(str(_last_name(path)))}[\"']?\s*=", line) and here == tables:
                return number
    return found


def _last_name(path: tuple[str | int, ...]) -> str:
    return next(step for step in reversed(path) if isinstance(step, str))

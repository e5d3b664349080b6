"""Scene files: what is simulated, as TOML."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypeVar

from ..io.files import read_text
from ..io.records import LONGEST_LIST, FieldError, Record, Text, about, read, schema
from ..io.toml_text import TomlError, loads
from ..ultrasound.needle_echo import LOOKS
from ..ultrasound.probe import PROBES
from .model_part import ModelPart
from .shipped import SHIPPED
from .tissue_settings import NO_TRACK

T = TypeVar("T")
Triple = tuple[float, float, float]
Source = Literal["kidney", "wide kidney", "gel block", "cube", "labels", "volume"]
Between = Literal["soft tissue", "fat"]
Face = Literal["x-", "x+", "y-", "y+", "z-", "z+"]
if TYPE_CHECKING:
    Look: TypeAlias = str
    ProbeKind: TypeAlias = str
else:
    Look, ProbeKind = Literal[tuple(LOOKS)], Literal[tuple(PROBES)]

LONGEST = 64 * 1024
"""Characters of a scene file."""


class TissuePart(Record, frozen=True, kw_only=True):
    """What the tissue is."""

    source: Annotated[Source, about("a generated phantom, a label map, or a real 3-D image")]
    file: Annotated[Text, about("label map or image, seen from the scene file")] | None = None
    names: Annotated[Text, about("CSV of label, name; by default the .csv beside the label map")] | None = None
    ct: Annotated[Text, about("CT of the same patient, for voxels without a label")] | None = None
    between: Annotated[Between, about("what lies between organs in the image, without a CT")] = "soft tissue"
    materials: Annotated[Text, about("TOML of materials by name; others are the assumed ones")] | None = None
    stiffness_kpa: Annotated[float, about("Young's modulus where there are no labels", low=1e-3, high=1e6)] = 10.0
    stiffening_mj_cm2: (
        Annotated[
            float,
            about(
                "energy under a pressed probe, for each cm2 of its face, at which it takes e times the force of linear "
                "tissue; none by default",
                low=1e-3,
                high=1e6,
            ),
        ]
        | None
    ) = None
    voxel_mm: Annotated[float, about("voxel of a generated phantom", low=0.2, high=4.0)] = 0.5
    entry_face: Annotated[Face, about("the free face, lattice axis and side; the other five are pinned")] = "z-"
    low: Annotated[Triple, about("one corner of the mechanical box, RAS mm; by default the whole image")] | None = None
    high: Annotated[Triple, about("the opposite corner")] | None = None
    nodes: Annotated[int, about("nodes of the display grid, about", low=1000, high=500_000)] = 40_000


class NeedlePart(Record, frozen=True, kw_only=True):
    """The needle and where it starts."""

    look: Annotated[Look, about("how it looks")] = "trocar"
    length_mm: Annotated[float, about("length from hub to tip", low=10.0, high=400.0)] = 150.0
    u: (
        Annotated[
            float,
            about(
                "entry to the right of the probe's place, mm; half way to the edge by default", low=-500.0, high=500.0
            ),
        ]
        | None
    ) = None
    v: Annotated[float, about("entry away from the viewer, mm", low=-500.0, high=500.0)] = 0.0
    angle: Annotated[float, about("to the right 0, straight down 90, to the left 180 degrees", low=5.0, high=175.0)] = (
        120.0
    )
    swing: Annotated[float, about("out of the image plane, degrees", low=-60.0, high=60.0)] = 0.0


class ProbePart(Record, frozen=True, kw_only=True):
    """The probe and its rest pose."""

    kind: Annotated[ProbeKind, about("its beams")] = "curvilinear"
    name: Annotated[Text, about("what to call it")] = "C5-2 curved"
    frequency_mhz: Annotated[float, about("centre frequency", low=1.0, high=20.0)] = 3.5
    depth_mm: Annotated[float, about("depth of the image", low=20.0, high=250.0)] = 120.0
    focus_mm: (
        Annotated[float, about("depth where the slice is thinnest; by default as the kind", low=5.0, high=250.0)] | None
    ) = None
    transmit_focus_mm: Annotated[float, about("depth the beams are sent to; 0: every depth", low=0.0, high=250.0)] = 0.0
    lines: Annotated[int, about("beams", low=16, high=512)] = 192
    at: Annotated[Triple, about("point of the skin it rests on, RAS mm; the middle of the face by default")] | None = (
        None
    )
    right: (
        Annotated[Triple, about("world direction to the right in the image; along the face's longer side by default")]
        | None
    ) = None
    press_mm: Annotated[float, about("how deep it is pressed in", low=0.0, high=30.0)] = 0.0
    presses: Annotated[bool, about("whether it dents the skin at the start; for models that know time")] = False
    slide: Annotated[float, about("where it starts, mm to the right of its place", low=-300.0, high=300.0)] = 0.0


class BreathingPart(Record, frozen=True, kw_only=True):
    """What breathing moves, and whether somebody breathes at the start."""

    cranial_face: Annotated[Face, about("the face towards the head, which the diaphragm presses on; not the skin")]
    organ: Annotated[
        tuple[Text, ...],
        about("names of the labels it is measured on; * stands for anything", longest=LONGEST_LIST),
    ]
    ratio: Annotated[float, about("excursion of the organ over that of the diaphragm", low=0.05, high=2.0)] = 0.65
    breathes: Annotated[bool, about("whether somebody breathes at the start; for models that know time")] = False
    depth: Annotated[float, about("of the breaths, over published ones", low=0.05, high=2.0)] = 1.0
    seed: Annotated[int, about("of the periods and heights of the breaths", low=0, high=2**31 - 1)] = 0


class TargetPart(Record, frozen=True, kw_only=True):
    """A place to reach."""

    name: Annotated[Text, about("what to call it")]
    at: Annotated[Triple, about("where it is in undeformed tissue, RAS mm")]


class DisplayPart(Record, frozen=True, kw_only=True):
    """The picture's grey levels, and when a target counts as reached."""

    gain_db: Annotated[float, about("added to the scanner's own gain", low=-60.0, high=60.0)] = 0.0
    range_db: Annotated[float, about("black to white", low=20.0, high=100.0)] = 60.0
    noise_db: Annotated[float, about("electronic noise over liver at the skin", low=-200.0, high=0.0)] = -70.0
    artefacts: Annotated[bool, about("clutter, haze, rough surfaces and walls, as real images have them")] = True
    textures: Annotated[bool, about("fibrils, septa and portal triads in tissues that have them")] = False
    tolerance_mm: Annotated[float, about("tip to target that counts as on target", low=0.1, high=50.0)] = 3.0


class SurfacePart(Record, frozen=True, kw_only=True):
    """One organ of the 3-D view."""

    name: Annotated[Text, about("what to call it")]
    tissues: Annotated[
        tuple[Text, ...], about("names of the labels it is made of; * stands for anything", longest=LONGEST_LIST)
    ]
    colour: Annotated[Text, about("#rrggbb")]
    opacity: Annotated[float, about("0 to 1", low=0.0, high=1.0)] = 1.0

    def __post_init__(self) -> None:
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", self.colour):
            raise FieldError(("colour",), f"= {self.colour!r} is no colour; give #rrggbb")


class MembranePart(Record, frozen=True, kw_only=True):
    """A wall between tissues that a tip has to break; for models whose needles leave tracks."""

    name: Annotated[Text, about("what to call it")]
    around: Annotated[tuple[Text, ...], about("names of the tissues inside it; * is anything", longest=LONGEST_LIST)]
    rupture_force_n: Annotated[float, about("force at the tip under which it breaks", low=1e-3, high=100.0)]
    rate: Annotated[float, about("part of it more for a tip e times as fast", low=-0.9, high=0.9)] = 0.0
    source: Annotated[Text, about("where these come from")] = "assumed"


class SceneFile(Record, frozen=True, kw_only=True):
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

    name: Annotated[Text, about("what to call it")]
    description: Annotated[Text, about("one line about it")] = ""
    tissue: Annotated[TissuePart, about("what the tissue is")]
    model: Annotated[ModelPart, about("how it answers")] = ModelPart()
    needle: Annotated[NeedlePart, about("the needle")] = NeedlePart()
    probe: Annotated[ProbePart, about("the probe")] = ProbePart()
    breathing: Annotated[BreathingPart | None, about("what breathing moves; by default nothing")] = None
    targets: Annotated[
        tuple[TargetPart, ...], about("places to reach; the phantoms have their own", longest=LONGEST_LIST)
    ] = ()
    display: Annotated[DisplayPart, about("grey levels and tolerance")] = DisplayPart()
    surfaces: Annotated[tuple[SurfacePart, ...], about("organs of the 3-D view", longest=LONGEST_LIST)] = ()
    membranes: Annotated[
        tuple[MembranePart, ...], about("walls that a tip has to break, where contact is a track", longest=LONGEST_LIST)
    ] = ()

    def __post_init__(self) -> None:
        if self.tissue.source in ("labels", "volume") and self.tissue.file is None:
            raise FieldError(("tissue", "file"), f"is missing; give the file of source = {self.tissue.source!r}")
        if (self.tissue.low is None) != (self.tissue.high is None):
            raise FieldError(("tissue", "low"), "and high belong together; give both corners or neither")
        if self.model.relaxation == "tissue" and self.model.contact == "pose":
            raise FieldError(("model", "relaxation"), NO_TRACK)
        if self.breathing is not None and self.breathing.cranial_face == self.tissue.entry_face:
            raise FieldError(
                ("breathing", "cranial_face"),
                f"= {self.tissue.entry_face!r} is the skin; give the face to the head",
            )

    @classmethod
    def parse(cls, text: str, *, file: str = "scene") -> SceneFile:
        """Return the scene a text describes.

        Raises
        ------
        SceneError
            Not TOML, an unknown or missing key, or a value out of range; it knows the line.
        """
        return parsed(cls, text, file)

    @classmethod
    def read(cls, path: str | Path) -> SceneFile:
        """Read a scene file."""
        return cls.parse(read_text(path, "scene", "a TOML file"), file=Path(path).name)

    @classmethod
    def shipped(cls, name: str) -> SceneFile:
        """Return a scene that comes with the package: ``kidney``, ``kidney-wide``, ``gel`` or ``cube``."""
        if name not in SHIPPED:
            raise ValueError(f"scene = {name!r} is not known; choose one of {', '.join(SHIPPED)}, or give a .toml file")
        return cls.parse(files(__package__).joinpath(f"scenes/{name}.toml").read_text(), file=f"{name}.toml")


def parsed(kind: type[T], text: str, file: str) -> T:
    """Return the record that a TOML text describes.

    Raises
    ------
    SceneError
        Not TOML, an unknown or missing key, or a value out of range; it knows the line.
    """
    if len(text) > LONGEST:
        raise SceneError(file, None, f"has {len(text)} characters; give at most {LONGEST}")
    try:
        return read(kind, loads(text))
    except TomlError as error:
        raise SceneError(file, error.line, f"is not TOML: {error.problem}") from None
    except FieldError as error:
        raise SceneError(file, line_of(text, error.path), str(error)) from None


class SceneError(ValueError):
    """A scene file that cannot be used: which file, which line, what is wrong and what would be right."""

    def __init__(self, file: str, line: int | None, problem: str) -> None:
        self.file, self.line, self.problem = file, line, problem
        super().__init__(f"{file}, line {line}: {problem}" if line else f"{file}: {problem}")


def scene_schema() -> dict[str, Any]:
    """Return the JSON schema of scene files."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema(SceneFile), "title": "Sonospline scene"}


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

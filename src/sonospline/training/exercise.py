"""Exercises: what a trainee is to do, where he or she begins, and what is enough, as TOML."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from .._digest import digest_of_bytes
from ..geometry.needle import Needle
from ..io.files import read_text
from ..io.records import LONGEST_LIST, FieldError, Record, Text, about
from ..simulator.command import Command
from ..simulator.scene import Scene
from ..simulator.scene_file import SceneFile, TargetPart, parsed
from ..simulator.shipped import SHIPPED
from ..simulator.tissue_settings import TissueSettings
from ..ultrasound.needle_echo import LOOKS
from .guide import Guide
from .metric import METRICS
from .task import Task

SHIPPED_EXERCISES = (
    "vessel-in-plane", "vessel-out-of-plane", "lesion-biopsy", "calyx-guided", "calyx-by-image", "calyx-breathing",
)  # fmt: skip
"""Names of the exercises that come with the package, from the easiest on."""

Range = tuple[float, float]
Names = Annotated[tuple[Text, ...], about("names; * and ? as in file names", longest=LONGEST_LIST)]
_KNOBS = ("u", "v", "angle", "swing", "slide", "sweep", "rotate", "fan")
_DRAWS = 1000
_CLEAR_MM = 1.0
"""From the skin at the start to bone, at least."""
_NOT_AIMED_MM = 6.0
"""By how much the axis of a needle at the start misses the target, at least."""


class StartPart(Record, frozen=True, kw_only=True):
    """Ranges that the start is drawn from, evenly; what is left out is as the scene has it."""

    u: Annotated[Range, about("entry along the image, mm")] | None = None
    v: Annotated[Range, about("entry across the image, mm")] | None = None
    angle: Annotated[Range, about("of the needle in plane, degrees")] | None = None
    swing: Annotated[Range, about("of the needle out of plane, degrees")] | None = None
    slide: Annotated[Range, about("of the probe along the image, mm")] | None = None
    sweep: Annotated[Range, about("of the probe across the image, mm")] | None = None
    rotate: Annotated[Range, about("of the probe, degrees")] | None = None
    fan: Annotated[Range, about("of the probe, degrees")] | None = None


class ZonePart(Record, frozen=True, kw_only=True):
    """Where on the skin the needle may enter."""

    u: Annotated[Range, about("along the image, mm")]
    v: Annotated[Range, about("across the image, mm")]


class MarkPart(Record, frozen=True, kw_only=True):
    """What a metric has to be to pass."""

    least: Annotated[float, about("at least so much")] | None = None
    most: Annotated[float, about("at most so much")] | None = None


class Exercise(Record, frozen=True, kw_only=True):
    """One exercise.

    Examples
    --------
    >>> from sonospline.training import Exercise
    >>> exercise = Exercise.shipped("vessel-in-plane")
    >>> exercise, sorted(exercise.pass_mark)[:2]
    (Exercise('Vessel, in plane', level 1 of 3, scene='gel'), ['back_wall_perforations', 'blind_advance_mm'])
    """

    name: Annotated[Text, about("what to call it")]
    description: Annotated[Text, about("the task, as the trainee reads it")]
    level: Annotated[int, about("1: guided, 2: by image, 3: the real lesson", low=1, high=3)]
    scene: Annotated[Text, about("a shipped scene, or a scene file seen from the exercise")]
    target: Annotated[Text, about("which of the scene's targets, or of the exercise's own")]
    targets: Annotated[tuple[TargetPart, ...], about("places of the exercise's own", longest=LONGEST_LIST)] = ()
    look: Annotated[Text, about("of the needle; by default the scene's")] | None = None
    model: Annotated[Text, about("of tissue; by default the scene's")] | None = None
    tissue: Annotated[TissueSettings, about("what it does in time")] = TissueSettings()
    guides: Annotated[tuple[Guide, ...], about("what may be shown beside the image", longest=LONGEST_LIST)] = ()
    forbidden: Names = ()
    target_in: Names = ()
    axis: Annotated[tuple[float, float, float], about("direction in which the needle should come")] | None = None
    time_limit_s: Annotated[float, about("for all of it", low=5.0, high=36_000.0)] = 300.0
    most_passes: Annotated[int, about("punctures of the skin, at most", low=1, high=100)] = 5
    start: Annotated[StartPart, about("ranges of the start")] = StartPart()
    entry_zone: Annotated[ZonePart, about("where the needle may enter")] | None = None
    pass_mark: Annotated[dict[str, MarkPart], about("what each metric has to be")]

    def __post_init__(self) -> None:
        for name, mark in self.pass_mark.items():
            if name not in METRICS:
                raise FieldError(("pass_mark", name), f"is no metric; choose of {', '.join(METRICS)}")
            least, most = mark.least, mark.most
            if least is None and most is None:
                raise FieldError(("pass_mark", name), "has neither least nor most; give one")
            if least is not None and most is not None and least > most:
                raise FieldError(("pass_mark", name), f"has least = {least:g} above most = {most:g}; exchange them")
        if self.look is not None and self.look not in LOOKS:
            raise FieldError(("look",), f"= {self.look!r} is not known; choose one of {', '.join(LOOKS)}")
        parts = {"start": self.start} | ({} if self.entry_zone is None else {"entry_zone": self.entry_zone})
        for part, ranges in parts.items():
            for knob in ranges.__struct_fields__:
                low, high = getattr(ranges, knob) or (0.0, 0.0)
                if low > high:
                    raise FieldError((part, knob), f"= ({low:g}, {high:g}) is empty; give the lower end first")

    @classmethod
    def parse(cls, text: str, *, file: str = "exercise") -> Exercise:
        """Return the exercise a text describes.

        Raises
        ------
        SceneError
            Not TOML, an unknown or missing key, or a value out of range.
        """
        return parsed(cls, text, file)

    @classmethod
    def read(cls, path: str | Path) -> Exercise:
        """Read an exercise file."""
        return cls.parse(read_text(path, "exercise", "a TOML file"), file=Path(path).name)

    @classmethod
    def shipped(cls, name: str) -> Exercise:
        """Return one of :data:`SHIPPED_EXERCISES`."""
        if name not in SHIPPED_EXERCISES:
            known = ", ".join(SHIPPED_EXERCISES)
            raise ValueError(f"exercise = {name!r} is not known; choose one of {known}, or read a .toml file")
        return cls.parse(files(__package__).joinpath(f"exercises/{name}.toml").read_text(), file=f"{name}.toml")

    @property
    def content_hash(self) -> str:
        """A short text that exercises of equal content share."""
        return digest_of_bytes(msgspec.json.encode(self))

    @property
    def task(self) -> Task:
        """What metrics depend on of it."""
        return Task(self.forbidden, self.target_in, self.axis)

    def scene_file(self, folder: Path | None = None) -> SceneFile:
        """Return its scene, with the needle and the targets of the exercise; files are seen from a folder."""
        found = (
            SceneFile.shipped(self.scene) if self.scene in SHIPPED else SceneFile.read((folder or Path()) / self.scene)
        )
        look = found.needle.look if self.look is None else self.look
        return msgspec.structs.replace(
            found, needle=msgspec.structs.replace(found.needle, look=look), targets=(*found.targets, *self.targets)
        )

    def start_in(self, scene: Scene, seed: int) -> Command:
        """Return where an attempt begins: drawn by a seed, the needle out and not aimed.

        Raises
        ------
        ValueError
            A start beyond the scene, in bone, or aimed whatever is drawn; a target that no needle reaches from the
            entry zone.
        """
        self.check(scene)
        rng = np.random.default_rng(seed)
        for _ in range(_DRAWS):
            command = self._drawn(scene, rng)
            scene.check(command)
            if self._is_startable(scene, command):
                return command
        raise ValueError(
            f"start of {self!r} is in bone or aimed within {_NOT_AIMED_MM:g} mm, in {_DRAWS} draws; give wider ranges"
        )

    def check(self, scene: Scene) -> None:
        """Raise ValueError where the exercise does not fit a scene."""
        if self.target not in scene.targets:
            known = ", ".join(scene.targets)
            raise ValueError(
                f"target = {self.target!r} of exercise {self.name!r} is not in its scene; give one of {known}"
            )
        reach, zone = scene.spec.needle.length_mm, self.entry_zone
        target = scene.targets[self.target]
        right, deep, out = scene.frame.parts(target - scene.frame.origin)
        ranges = ((right, right), (out, out)) if zone is None else (zone.u, zone.v)
        beside = [max(low - at, at - high, 0.0) for (low, high), at in zip(ranges, (right, out), strict=True)]
        nearest = float(np.linalg.norm([*beside, deep]))
        if nearest > reach:
            raise ValueError(
                f"target {self.target!r} of {self!r} is {nearest:.4g} mm from the entry zone, and the needle is "
                f"{reach:g} mm long; widen the zone"
            )

    def _drawn(self, scene: Scene, rng: np.random.Generator) -> Command:
        drawn = {
            knob: float(rng.uniform(*found)) for knob in _KNOBS if (found := getattr(self.start, knob)) is not None
        }
        needle, probe = ({knob: drawn[knob] for knob in knobs if knob in drawn} for knobs in (_KNOBS[:4], _KNOBS[4:]))
        start = scene.start
        return msgspec.structs.replace(
            start, needle=msgspec.structs.replace(start.needle, depth=0.0, **needle),
            probe=msgspec.structs.replace(start.probe, **probe), tissue=self.tissue,
        )  # fmt: skip

    def _is_startable(self, scene: Scene, command: Command) -> bool:
        """Whether the needle at the skin is beside bone, and its axis beside the target."""
        entry, along = scene.frame.entry(command.needle), scene.frame.direction(command.needle)
        if scene.tissues is not None and scene.tissues.obstacle(Needle(entry, entry + _CLEAR_MM * along)) is not None:
            return False
        to_target = scene.targets[self.target] - entry
        return bool(np.linalg.norm(to_target - (to_target @ along) * along) >= _NOT_AIMED_MM)

    def __repr__(self) -> str:
        return f"Exercise({self.name!r}, level {self.level} of 3, scene={self.scene!r})"

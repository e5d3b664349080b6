"""Knobs: the numbers a hand can move, each described once; keys, buttons, help and limits follow from here.

A knob is a field of a group of :class:`~sonospline.simulator.Command`, annotated with its :class:`Knob` and the
:class:`Travel` it has in a scene. A new one is a field there, and its effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, get_args, get_type_hints

from msgspec import Struct
from msgspec.structs import asdict

from .._shown import figure, inside
from ..io.records import FieldError

if TYPE_CHECKING:
    from ..ultrasound.probe import Probe
    from .scene_file import SceneFile

C = TypeVar("C", bound=Struct)
Range = tuple[float, float]
Group = Literal["needle", "probe", "image"]
Sense = Literal["less-more", "left-right", "near-far", "turn"]
Pad = Literal[
    "left stick across", "left stick along", "right stick across", "right stick along", "triggers", "bumpers",
    "d-pad across", "d-pad along",
]  # fmt: skip
"""Pairs of the standard gamepad; along is away from the hand."""

_SLACK = 1e-6


class Knob(Struct, frozen=True, kw_only=True):
    """What a number is called, how it moves, and which keys move it."""

    name: str
    short: str
    """Its name where there is little room."""
    help: str
    """What it does, in a few words."""
    unit: Literal["mm", "cm", "°", "dB", "MHz", "kHz"]
    shown: float = 1.0
    """How many of its own units (mm, degrees, dB, MHz, Hz) one of those shown is."""
    decimals: int = 1
    step: float
    """For one tap, in its own unit."""
    rate: float
    """The same a second, while it is held."""
    setting: bool = False
    """Whether it goes from step to step, at once, and knows neither slow nor fast."""
    sense: Sense = "less-more"
    """What its two ways look like."""
    down: str
    up: str
    """What going down and going up are called."""
    keys: tuple[str, str] | None = None
    """The keys that move it down and up, as ``KeyboardEvent.code`` names them."""
    pad: Pad | None = None
    """What of a gamepad moves it."""


class SceneKnob(Knob, frozen=True, kw_only=True):
    """A knob as it is in a scene."""

    id: str
    """Group and field: ``needle.depth``."""
    group: Group
    field: str
    low: float
    high: float

    def value(self, command: Struct) -> float:
        """Return where a command has it."""
        value: float = getattr(getattr(command, self.group), self.field)
        return value


class Circumstances(NamedTuple):
    """What of a scene decides how far knobs go."""

    spec: SceneFile
    probe: Probe
    along: Range
    """Sides of the tissue to the right of where the probe rests, mm."""
    across: Range
    """Sides of the tissue away from the viewer, mm."""
    deep: float
    """Of the tissue below the skin, mm."""
    synthetic: bool
    """Whether the picture is computed: a real one has its frequency and focus."""


class Words(Struct, frozen=True, kw_only=True):
    """What a word is called, or a number, that is chosen and not moved; its type says which there are."""

    name: str
    help: str


@dataclass(frozen=True)
class Travel:
    """How far a knob goes in a scene, and where it is at first."""

    within: Callable[[Circumstances], Range]
    start: Callable[[Circumstances], float] = lambda scene: 0.0


def always(low: float, high: float) -> Callable[[Circumstances], Range]:
    """Return the same range in every scene."""
    return lambda scene: (low, high)


@dataclass(frozen=True)
class Knobs:
    """The knobs of a scene, in order."""

    all: tuple[SceneKnob, ...]

    @classmethod
    def of(cls, kind: type[Struct], scene: Circumstances) -> Knobs:
        """Return the knobs of a kind of command, as far as they go in a scene."""
        return cls(
            tuple(_in_scene(group, field, knob, travel.within(scene)) for group, field, knob, travel in described(kind))
        )

    def __iter__(self) -> Iterator[SceneKnob]:
        return iter(self.all)

    def __getitem__(self, id: str) -> SceneKnob:
        return {knob.id: knob for knob in self.all}[id]

    def check(self, command: Struct) -> None:
        """Raise FieldError for the first number that is beyond its range (or NaN)."""
        for knob in self.all:
            value = knob.value(command)
            if not knob.low - _SLACK <= value <= knob.high + _SLACK:
                lowest, highest = inside(knob.low, knob.high, slack=_SLACK)
                problem = f"= {figure(value)} is out of range; give {lowest} to {highest} in this scene"
                raise FieldError((knob.group, knob.field), problem)


def start(kind: type[C], scene: Circumstances) -> C:
    """Return where a scene puts every knob at first."""
    groups: dict[str, dict[str, float]] = {}
    for group, field, _, travel in described(kind):
        groups.setdefault(group, {})[field] = travel.start(scene)
    kinds = get_type_hints(kind)
    return kind(**{group: kinds[group](**values) for group, values in groups.items()})


@lru_cache(maxsize=8)
def described(kind: type[Struct]) -> tuple[tuple[Group, str, Knob, Travel], ...]:
    """Return group, field, knob and travel of every number of a kind of command, in order."""
    found: list[tuple[Group, str, Knob, Travel]] = []
    for group in get_args(Group):
        for field, hint in get_type_hints(get_type_hints(kind)[group], include_extras=True).items():
            if not any(isinstance(one, Words) for one in getattr(hint, "__metadata__", ())):
                found.append((group, field, *_annotations(f"{group}.{field}", hint)))
    return tuple(found)


def _annotations(name: str, hint: Any) -> tuple[Knob, Travel]:
    said = getattr(hint, "__metadata__", ())
    knob = next((one for one in said if isinstance(one, Knob)), None)
    travel = next((one for one in said if isinstance(one, Travel)), None)
    if knob is None or travel is None:
        raise TypeError(f"{name} has no Knob or no Travel; annotate the field with both")
    return knob, travel


def _in_scene(group: Group, field: str, knob: Knob, within: Range) -> SceneKnob:
    low, high = within
    return SceneKnob(**asdict(knob), id=f"{group}.{field}", group=group, field=field, low=low, high=high)

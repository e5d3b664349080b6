"""What the server says: JSON texts. The page's types are made from these, see :mod:`sonospline.server.schema`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from msgspec import Struct

from .. import models
from ..simulator.command import Command
from ..simulator.knobs import SceneKnob
from ..training.guide import Guide
from .client_messages import snake_case

if TYPE_CHECKING:
    from ..simulator.console import Console
    from ..ultrasound.probe import Probe

PROTOCOL: Literal[5] = 5

Vector = tuple[float, float, float]


class ServerMessage(Struct, frozen=True, tag=snake_case):
    """A message by its ``type``."""


class OfferedScene(Struct, frozen=True, kw_only=True):
    """A scene that can be chosen."""

    id: str
    name: str
    description: str


class Hello(ServerMessage, frozen=True, kw_only=True):
    """The first message."""

    version: str
    protocol: Literal[5]
    scenes: tuple[OfferedScene, ...]
    session: str
    """The key with which a page comes back to its session."""
    resumed: bool
    """Whether it has."""


class Loading(ServerMessage, frozen=True, kw_only=True):
    """A scene is being made."""

    scene: str
    name: str
    share: float
    """0 to 1."""


class SkinDirections(Struct, frozen=True, kw_only=True):
    """Unit vectors along the skin, into the tissue and away from the viewer (right x depth), and where they meet."""

    right: Vector
    depth: Vector
    out: Vector
    skin_origin: Vector


class Box(Struct, frozen=True, kw_only=True):
    """Corners of the tissue."""

    low: Vector
    high: Vector


class Choice(Struct, frozen=True, kw_only=True):
    """Something that can be chosen."""

    id: str
    name: str


class OfferedModel(Choice, frozen=True, kw_only=True):
    """A model of tissue that can be chosen, and what it can do."""

    forces: bool
    time: bool
    """Whether seconds matter to it."""


class OfferedTarget(Choice, frozen=True, kw_only=True):
    """A target that can be chosen."""

    at: Vector | None
    """Where it is in tissue at rest, RAS mm; None where that may not be shown."""


class ProbeOutline(Struct, frozen=True, kw_only=True):
    """What a probe looks like and sees, in its own frame: x right, y deep, origin in the middle of its face; mm."""

    name: str
    beams: tuple[tuple[float, float, float, float], ...]
    """From left to right: where a beam leaves the face, x and y, and its direction, x and y."""
    face_radius_mm: float
    """Of a convex face; 0 where it is flat."""
    width_mm: float
    thickness_mm: float
    """Of its housing at the face."""


class NeedleOutline(Struct, frozen=True, kw_only=True):
    """What a needle looks like."""

    length_mm: float


class Zone(Struct, frozen=True, kw_only=True):
    """Where the needle may enter, mm along and across the image."""

    u: tuple[float, float]
    v: tuple[float, float]


class OfferedMark(Struct, frozen=True, kw_only=True):
    """What a metric has to be to pass."""

    metric: str
    unit: str
    least: float | None
    most: float | None


class OfferedExercise(Struct, frozen=True, kw_only=True):
    """An exercise that can be chosen, as its briefing says it."""

    id: str
    name: str
    description: str
    level: int
    target: str
    guides: tuple[Guide, ...]
    forbidden: tuple[str, ...]
    breathes: bool
    time_limit_s: float
    most_passes: int
    zone: Zone | None
    marks: tuple[OfferedMark, ...]


class Exercises(ServerMessage, frozen=True, kw_only=True):
    """Those on offer."""

    offered: tuple[OfferedExercise, ...]


class RunningAttempt(Struct, frozen=True, kw_only=True):
    """The attempt that a scene is worked in."""

    exercise: OfferedExercise
    seed: int
    recorded: str
    """Why it is not recorded; empty where it is."""


class SceneMessage(ServerMessage, frozen=True, kw_only=True, tag="scene"):
    """What a page has to know of a scene before its first frame."""

    id: str
    name: str
    frame: SkinDirections
    box: Box
    models: tuple[OfferedModel, ...]
    model: str
    probe: ProbeOutline
    needle: NeedleOutline
    targets: tuple[OfferedTarget, ...]
    target: str
    attempt: RunningAttempt | None
    """None in free practice."""
    guides: tuple[Guide, ...]
    """What may be shown beside the image."""
    breathes: bool
    """Whether its file says how breathing moves it."""
    flows: bool
    """Whether anything flows in it, which colour Doppler would show."""
    tolerance_mm: float
    """Tip to target that counts as on target."""
    knobs: tuple[SceneKnob, ...]
    state: Command
    """What is in force."""
    start: Command
    """Where the scene starts."""

    @classmethod
    def of(
        cls, id: str, console: Console, state: Command, start: Command, guides: frozenset[Guide],
        attempt: RunningAttempt | None = None,
    ) -> SceneMessage:  # fmt: skip
        """Return what is to be said of the scene that a page works on."""
        scene, spec = console.scene, console.scene.spec
        shown = attempt is None and "target" in guides
        right, depth, out, origin = (
            tuple(v.tolist()) for v in (scene.frame.right, scene.frame.depth, scene.frame.out, scene.frame.origin)
        )
        low, high = (tuple(corner.tolist()) for corner in scene.box)
        return cls(
            id=id, name=spec.name, frame=SkinDirections(right=right, depth=depth, out=out, skin_origin=origin),
            box=Box(low=low, high=high),
            models=tuple(_offered(name) for name in models.names()),
            model=console.session.model,
            probe=outline(spec.probe.name, scene.probe), needle=NeedleOutline(length_mm=spec.needle.length_mm),
            targets=tuple(
                OfferedTarget(id=name, name=name.capitalize(), at=tuple(at.tolist()) if shown else None)
                for name, at in scene.targets.items()
            ),
            attempt=attempt, guides=tuple(sorted(guides)),
            target=console.session.target, breathes=spec.breathing is not None, flows=scene.flows,
            tolerance_mm=spec.display.tolerance_mm, knobs=scene.knobs.all, state=state,
            start=start,
        )  # fmt: skip


class ModelMessage(ServerMessage, frozen=True, kw_only=True, tag="model"):
    """Another model answers from now on."""

    model: str


class TargetMessage(ServerMessage, frozen=True, kw_only=True, tag="target"):
    """Another target is aimed at from now on."""

    id: str


class Refused(ServerMessage, frozen=True, kw_only=True):
    """A message was not heeded."""

    what: str
    message: str
    file: str | None = None
    line: int | None = None
    seq: int | None = None


class Notice(ServerMessage, frozen=True, kw_only=True):
    """For whoever sits there; after a fault the last picture stays."""

    level: Literal["caution", "fault"]
    message: str


class Pong(ServerMessage, frozen=True, kw_only=True):
    """A sign of life."""


class ExpertBand(Struct, frozen=True, kw_only=True):
    """What attempts of an expert have reached in a metric."""

    mean: float
    deviation: float
    low: float
    high: float
    attempts: int


class MeasuredMetric(Struct, frozen=True, kw_only=True):
    """A metric of an attempt; numbers that are not known are none."""

    name: str
    unit: str
    better: Literal["less", "more", "neither"]
    definition: str
    source: str
    value: float | None
    least: float | None
    most: float | None
    """What it has to be, where the exercise says so."""
    passed: bool | None
    band: ExpertBand | None
    z: float | None
    """Deviations from the expert's mean; None where all of the expert's attempts were alike."""


class Happened(Struct, frozen=True, kw_only=True):
    """Something that happened in an attempt."""

    time_s: float
    kind: Literal["skin", "out", "tissue", "blind", "back", "end"]
    text: str
    until_s: float | None
    """When it ended, where it lasted."""


class Course(Struct, frozen=True, kw_only=True):
    """An attempt over its time; lengths in mm, places to the right, deeper and away from the viewer."""

    time_s: tuple[float, ...]
    depth: tuple[float, ...]
    out_of_plane: tuple[float | None, ...]
    """Of the tip, towards the viewer is plus; none while the needle is out."""
    half_slice: tuple[float | None, ...]
    to_target: tuple[float | None, ...]
    force: tuple[float | None, ...]
    tip: tuple[Vector | None, ...]
    entry: tuple[Vector | None, ...]
    target: tuple[Vector, ...]
    step: tuple[int, ...]
    """The step of the recording that shows each."""


class Debrief(ServerMessage, frozen=True, kw_only=True):
    """What an attempt came to; the geometry may follow, and frames of its replay at ``show_step``."""

    exercise: OfferedExercise
    seed: int
    ended: Literal["on target", "given up", "time is up", "too many passes"]
    passed: bool
    story: tuple[str, ...]
    metrics: tuple[MeasuredMetric, ...]
    band: str
    """How the expert's band was made; empty where there is none."""
    happened: tuple[Happened, ...]
    course: Course
    steps: int
    """Of the recording that can be replayed; 0 where there is none."""
    problem: str
    """Why there is none, or why frames may differ; empty where all is well."""


class Comment(Struct, frozen=True, kw_only=True):
    """What the trainer says of a moment of an attempt."""

    time_s: float
    text: str


class Comments(ServerMessage, frozen=True, kw_only=True):
    """Those kept beside the recording of the attempt that is talked about, in the order of their times."""

    comments: tuple[Comment, ...]


class StationMessage(ServerMessage, frozen=True, kw_only=True, tag="station"):
    """In a lab: which station this is, who sits there, and what the trainer has set."""

    name: str
    participant: str | None
    exercise: str | None
    """Id of the one that is to be done; None leaves the choice."""
    guides_locked: bool
    models_locked: bool
    hands_locked: bool
    """Frozen by the trainer: time stands still, and nothing counts."""
    said: str
    """By the trainer, for whoever sits there."""
    comments: tuple[Comment, ...]
    """On the attempt that is talked about, in the order of their times."""


Said = (
    Hello | Loading | SceneMessage | ModelMessage | TargetMessage | Exercises | Debrief | Comments | StationMessage
    | Refused | Notice | Pong
)  # fmt: skip


def _offered(name: str) -> OfferedModel:
    spec = models.spec(name)
    able = spec.capabilities
    return OfferedModel(id=name, name=spec.title, forces="forces" in able, time="time" in able)


def outline(name: str, probe: Probe) -> ProbeOutline:
    """Return what a probe looks like and sees."""
    width, thickness = probe.housing_mm
    beams = tuple(tuple(beam) for beam in probe.beam_lines().tolist())
    return ProbeOutline(
        name=name, beams=beams, face_radius_mm=probe.apex_mm, width_mm=width, thickness_mm=thickness
    )  # fmt: skip

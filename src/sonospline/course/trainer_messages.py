"""What the trainer's page may say, and what it is told."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from msgspec import Struct

from ..io.records import Text, about
from ..lab.schema import LONGEST_CODE, LONGEST_COMMENT
from ..server.client_messages import ClientMessage, Drawn, Ping
from ..server.server_messages import (
    Choice,
    Comment,
    ModelMessage,
    Notice,
    Pong,
    Refused,
    SceneMessage,
    ServerMessage,
    TargetMessage,
)  # fmt: skip

LONGEST_LINE = 200
MOST_CODES = 64

Where = Annotated[Text, about("name of a station; none for all of them")] | None


class WatchStation(ClientMessage, frozen=True, kw_only=True):
    """Asks for everything that a station's page is sent."""

    station: Annotated[Text, about("name of a station; none for none")] | None
    meshes: Annotated[bool, about("whether those of the 3-D view are wanted")] = False


class SetExercise(ClientMessage, frozen=True, kw_only=True):
    """Has an exercise done, and no other one."""

    station: Where
    exercise: Annotated[Text, about("id of one of those on offer; none leaves the choice")] | None


class LockStation(ClientMessage, frozen=True, kw_only=True):
    """Keeps guides off in free practice, the model as it is, or hands: time stands still, and nothing counts."""

    station: Where
    what: Annotated[Literal["guides", "models", "hands"], about("what is locked")]
    on: Annotated[bool, about("whether it is")]


class SayToStation(ClientMessage, frozen=True, kw_only=True):
    """Has a line shown to whoever sits there; an empty one takes the last away."""

    station: Where
    text: Annotated[str, about("a line", longest=LONGEST_LINE)]


class CommentOn(ClientMessage, frozen=True, kw_only=True):
    """Says something of a moment of the attempt at a station, which is kept with it and shown in its debrief."""

    station: Annotated[Text, about("name of a station")]
    time_s: Annotated[float, about("since the attempt began, s", low=0, high=1e6)]
    text: Annotated[str, about("what is to be said", longest=LONGEST_COMMENT)]


Codes = Annotated[tuple[Annotated[str, about("a code", longest=LONGEST_CODE)], ...], about("codes", longest=MOST_CODES)]


class AddParticipants(ClientMessage, frozen=True, kw_only=True):
    """Adds participants by their codes."""

    codes: Codes
    group: Annotated[Text, about("name of their group")] | None


class ListResults(ClientMessage, frozen=True, kw_only=True):
    """Asks where participants stand, and for the learning curves of an exercise."""

    today: Annotated[bool, about("whether standings are of today alone")]
    exercise: Annotated[Text, about("name of one, as results have it; by default that of the last attempt")] | None


Message = (
    WatchStation | SetExercise | LockStation | SayToStation | CommentOn | AddParticipants | ListResults | Drawn | Ping
)  # fmt: skip
KINDS: dict[str, type[Any]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Message)}


class LabHello(ServerMessage, frozen=True, kw_only=True):
    """The first message."""

    protocol: Literal[5]
    results: str
    """What the database is called: a file without its folder, an address without its password."""
    course: str
    """The session of the lab to which attempts belong."""
    exercises: tuple[Choice, ...]


State = Literal["empty", "no code", "loading", "practice", "running", "debrief"]


class StationState(Struct, frozen=True, kw_only=True):
    """What the trainer sees of a station; numbers that are not known are none."""

    name: str
    participant: str | None
    state: State
    exercise: str | None
    """Name of the one that runs or is talked about."""
    exercise_set: str | None
    """Id of the one that the trainer has set."""
    guides_locked: bool
    models_locked: bool
    hands_locked: bool
    """Whether it is frozen by the trainer."""
    word: str
    """The state in a word or two."""
    caution: bool
    time_s: float
    """Of the attempt or the practice; in a debrief that of the picture."""
    limit_s: float | None
    passes: int
    to_target_mm: float | None
    out_of_plane_mm: float | None
    """Towards the viewer is plus."""
    half_slice_mm: float | None
    depth_mm: float | None
    blind_mm: float | None
    force_n: float | None
    verdict: str
    """Of the attempt that is talked about; else empty."""
    said: str
    comments: tuple[Comment, ...]
    frame: int
    """Number of the picture, which changes with it."""


class Stations(ServerMessage, frozen=True, kw_only=True):
    """Every station, whenever something has changed."""

    stations: tuple[StationState, ...]
    waiting: int
    """Results that are not kept yet."""
    problem: str
    """Why; empty where all is well."""


class StandingRow(Struct, frozen=True, kw_only=True):
    """Where a participant stands at an exercise."""

    participant: str
    group: str | None
    exercise: str
    attempts: int
    passed: int
    last: str
    """When the last attempt began, ISO 8601, UTC."""
    last_passed: bool
    last_verdict: str
    final_error_mm: float | None
    blind_advance_mm: float | None


class CurveRow(Struct, frozen=True, kw_only=True):
    """The learning curve of a participant: the CUSUM after each attempt."""

    participant: str
    sums: tuple[float, ...]
    decision: Literal["proficient", "needs teaching", "undecided"]


class Results(ServerMessage, frozen=True, kw_only=True):
    """What has been kept."""

    standings: tuple[StandingRow, ...]
    exercise: str | None
    """Whose learning curves these are."""
    exercises: tuple[str, ...]
    """Names of those that were attempted."""
    curves: tuple[CurveRow, ...]
    acceptable: float
    unacceptable: float
    """Shares of failures."""
    upper: float
    lower: float
    """Where the curve says "needs teaching", and "proficient"."""
    participants: tuple[str, ...]


class ThumbHeader(Struct, frozen=True, kw_only=True):
    """A small picture of a station; grey levels follow, row by row."""

    station: str
    rows: int
    columns: int


Said = (
    LabHello | Stations | Results | SceneMessage | ModelMessage | TargetMessage | Refused | Notice | Pong
)  # fmt: skip

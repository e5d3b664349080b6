"""One station of a lab: who sits there, what is worked on, and what the trainer has set."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

from msgspec import structs

from ..lab.kept_text import check_code
from ..server import client_messages as heard
from ..server.client_messages import MessageError
from ..server.live_attempt import LiveAttempt
from ..server.practice import Practice
from ..server.seat import Seat, SeatedPage
from ..server.server_messages import Comment, Refused, StationMessage
from ..server.wire import PassSummary, ReplayedStep
from ..training.guide import ALL_GUIDES
from .attempt_notes import AttemptNotes
from .office import Office

if TYPE_CHECKING:
    from ..server.stage import Stage
    from ..simulator.command import Command
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.scene import Scene


_MOVES = (
    heard.ChooseModel | heard.ChooseScene | heard.OpenScene | heard.ChooseTarget | heard.UndoPass | heard.Reset
    | heard.Restore | heard.BeginAttempt | heard.OnTarget | heard.GiveUp
)  # fmt: skip
"""What is not heeded while time stands still."""


class Seen(NamedTuple):
    """The newest picture of a station's page."""

    shown: ConsoleFrame
    replay: ReplayedStep | None
    summary: PassSummary
    frame: int
    scene: Scene


class Watcher(Protocol):
    """A trainer's page that watches a station."""

    def show_scene(self, name: str, stage: Stage) -> None:
        """Something is worked on from now on."""

    def show(self, seen: Seen) -> None:
        """A picture is on its way; in the thread that made it."""


class Station(Seat):
    """A station; its page is a connection as any other.

    Everything happens in the socket's loop, but for :meth:`saw` and the end of an attempt.

    Parameters
    ----------
    name : str
        What it is called.
    office : Office
        Of the course it belongs to.
    """

    def __init__(self, name: str, office: Office) -> None:
        self.name, self._office = name, office
        self.connection: SeatedPage | None = None
        self.key = ""
        """Of the session of its page."""
        self.participant: str | None = None
        self.exercise_set: str | None = None
        self.guides_locked = self.models_locked = self.hands_locked = False
        self.said = ""
        self.working: tuple[str, Stage] | None = None
        """What is worked on, with the id of its scene or exercise."""
        self.seen: Seen | None = None
        self.watchers: frozenset[Watcher] = frozenset()
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def attempt(self) -> LiveAttempt | None:
        """The attempt that runs, or is talked about."""
        stage = None if self.working is None else self.working[1]
        return cast(LiveAttempt, stage) if stage is not None and stage.exercise is not None else None

    @property
    def comments(self) -> list[Comment]:
        """On the attempt that runs or is over."""
        notes = None if self.attempt is None else self.attempt.on_result
        return notes.comments if isinstance(notes, AttemptNotes) else []

    def take(self, page: SeatedPage) -> None:
        """A page has come: another one than before is somebody else's."""
        if page.key != self.key:
            self.participant, self.said, self.working, self.seen = None, "", None, None
        self.connection, self.key = page, page.key
        self.tell()

    def leave(self, page: SeatedPage) -> None:
        """It has gone; it may come back."""
        if self.connection is page:
            self.connection = None

    def refusal(self, message: heard.Message) -> str | None:
        """What the trainer has set is not changed by who sits there."""
        if self.hands_locked and isinstance(message, _MOVES):
            return "comes while the trainer has frozen this station; wait"
        match message:
            case heard.BeginAttempt() if self.participant is None:
                return "comes before anybody has sat down; enter your code"
            case heard.BeginAttempt() if self.exercise_set not in (None, message.exercise):
                return f"is not what the trainer has set; begin {self._title(self.exercise_set)}"
            case heard.ChooseScene() | heard.OpenScene() if self.exercise_set is not None:
                return f"is not what the trainer has set; begin {self._title(self.exercise_set)}"
            case heard.AddComment():
                return "is for the trainer of the lab"
            case heard.ChooseModel() if self.models_locked:
                return "is locked by the trainer"
        return None

    def sit_down(self, participant: str | None) -> None:
        """Let somebody sit down whose code is known, and who sits nowhere else."""
        if self.attempt is not None and not self.attempt.over:
            raise MessageError("sit_down", "comes while an exercise runs; end it first")
        if participant is None:
            self.participant = None
            self.tell()
            return
        try:
            code = check_code(participant)
        except ValueError as error:
            raise MessageError("sit_down", str(error)) from None
        self._begin(self._seat(code))

    def set_exercise(self, exercise: str | None) -> None:
        """Have an exercise done, once what runs is over; None leaves the choice."""
        self.exercise_set = exercise
        self.tell()

    def lock(self, what: str, on: bool) -> None:
        """Keep guides off in free practice, the model as it is, or hands."""
        if what == "models":
            self.models_locked = on
        elif what == "hands":
            self.hands_locked = on
            if self.connection is not None:
                self.connection.freeze(on)
        elif on != self.guides_locked:
            self.guides_locked = on
            if self.connection is not None and self.working is not None and self.attempt is None:
                self._begin(self.connection.begin_again())
        self.tell()

    def heeded(self, command: Command) -> Command:
        """Let nothing move while the trainer has frozen the station."""
        return structs.replace(command, frozen=True) if self.hands_locked else command

    def say(self, text: str) -> None:
        """Show a line to whoever sits there."""
        self.said = text.strip()
        self.tell()

    def comment(self, time_s: float, text: str) -> None:
        """Say something of a moment of the attempt."""
        if self.attempt is None:
            raise MessageError("comment_on", f"comes while no exercise is done at {self.name}; set one")
        self._notes(self.attempt).comment(time_s, text)
        if self.attempt.over:
            self.tell()

    def tell(self) -> None:
        """Say to the page how its station stands; comments come with the debrief."""
        if self.connection is None:
            return
        over = self.attempt is not None and self.attempt.over
        self.connection.sender.say(
            StationMessage(
                name=self.name, participant=self.participant, exercise=self.exercise_set,
                guides_locked=self.guides_locked, models_locked=self.models_locked,
                hands_locked=self.hands_locked, said=self.said,
                comments=tuple(self.comments) if over else (),
            )
        )  # fmt: skip

    def began(self, name: str, stage: Stage) -> None:
        """Something is worked on from now on; it may be what was worked on before."""
        before = None if self.working is None else self.working[1]
        self.working = name, stage
        if stage is not before:
            self.seen = None
        if self.attempt is None:
            cast(Practice, stage).guides = frozenset() if self.guides_locked else ALL_GUIDES
        else:
            self._go_on(self._notes(self.attempt))
        for watcher in self.watchers:
            watcher.show_scene(name, stage)

    def saw(self, shown: ConsoleFrame, replay: ReplayedStep | None) -> None:
        """A picture is on its way to the page; in the thread that made it."""
        if self.working is None:
            return
        frame = 1 if self.seen is None else self.seen.frame + 1
        if replay is None:
            summary = self.working[1].measured(shown)
        else:
            summary = PassSummary(time_s=replay.time_s, passes=shown.metrics.passes, path_mm=None, blind_mm=None)
        self.seen = seen = Seen(shown, replay, summary, frame, self.working[1].scene)
        for watcher in self.watchers:
            watcher.show(seen)

    async def _seat(self, code: str) -> None:
        """Ask the results who that is, and let him or her sit down."""
        problem = await self._office.why_unknown(code)
        if problem is None and self._office.seat_of(code) not in (None, self):
            problem = f"code = {code!r} sits at another station; give your own"
        if problem is None:
            self.participant = code
            self.tell()
        elif self.connection is not None:
            self.connection.sender.say(Refused(what="sit_down", message=problem))

    def ended(self, attempt: LiveAttempt) -> None:
        """An attempt is over, which may be this station's no more; in the thread that stepped it."""
        if self.attempt is attempt and self.connection is not None:
            self.connection.sender.call(lambda _: self.tell(), None)

    def report(self, line: str) -> None:
        """Say what goes wrong with a result; in any thread."""
        connection = self.connection
        if connection is not None:
            connection.sender.report(line)

    def _notes(self, attempt: LiveAttempt) -> AttemptNotes:
        """Those of an attempt, which may have come from another station."""
        if not isinstance(attempt.on_result, AttemptNotes):
            attempt.on_result = AttemptNotes(self.participant or "", self._office, self)
        return attempt.on_result

    def _go_on(self, notes: AttemptNotes) -> None:
        """Who works on an attempt sits here from now on, unless somebody else uses that code elsewhere."""
        if notes.station is self:
            return
        notes.station = self
        if self._office.seat_of(notes.participant) in (None, self):
            self.participant = notes.participant
        self.tell()

    def _title(self, exercise: str | None) -> str:
        return "" if exercise is None else self._office.title(exercise)

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

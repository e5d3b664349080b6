"""One trainer's page on one WebSocket: what it says, heeded or refused, and what it is shown."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Coroutine, Iterator
from typing import TYPE_CHECKING, Any

from ..lab.database import LabDatabaseError
from ..lab.kept_text import check_comment
from ..server import wire
from ..server.client_messages import Drawn, MessageError, Ping
from ..server.mesh_flow import MeshFlow
from ..server.outbox import Outbox
from ..server.server_messages import PROTOCOL, ModelMessage, Pong, SceneMessage, TargetMessage
from ..server.speaker import Speaker
from ..training.guide import ALL_GUIDES
from . import trainer_messages as heard
from .course import Course
from .station import Seen, Station
from .station_state import state_of
from .thumb import thumb

if TYPE_CHECKING:
    from ..server.stage import Stage

_LOOK_S = 0.25
"""Between two looks at the stations."""
_THUMBS = 4
"""Looks between two rounds of small pictures."""
_MESH_HZ = 8.0
"""Positions of the 3-D view a second at most."""
_AHEAD = 2
"""Pictures on their way to a page that has not drawn them yet."""


class TrainerConnection(Speaker):
    """What stands between a trainer's page and the stations.

    Parameters
    ----------
    course : Course
        The stations.
    outbox : Outbox
        Where messages to the page go.
    """

    def __init__(self, course: Course, outbox: Outbox) -> None:
        super().__init__(heard.KINDS, outbox)
        self._course, self._outbox = course, outbox
        self._watched: Station | None = None
        self._meshes, self._meshes_wanted = MeshFlow(_MESH_HZ), False
        self._flying: deque[int] = deque()
        self._frames = 0
        self._seen: Seen | None = None
        self._showing = threading.Lock()
        self._named: tuple[str, str] | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    def open(self) -> None:
        """Greet the page, and go on telling how the stations stand."""
        self.sender.say(
            heard.LabHello(
                protocol=PROTOCOL, results=self._course.store.name, course=self._course.name,
                exercises=self._course.exercises,
            )
        )  # fmt: skip
        self._begin(self._look())

    async def close(self) -> None:
        """Watch nothing any more."""
        self._watch(None)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _heed(self, message: heard.Message) -> None:
        match message:
            case Drawn():
                self._drawn(message.frame)
            case Ping():
                self.sender.say(Pong())
            case heard.WatchStation():
                station = None if message.station is None else self._station("watch_station", message.station)
                self._watch(station, message.meshes)
            case heard.SetExercise():
                self._set_exercise(message)
            case heard.LockStation():
                for station in self._stations("lock_station", message.station):
                    station.lock(message.what, message.on)
            case heard.SayToStation():
                for station in self._stations("say_to_station", message.station):
                    station.say(message.text)
            case heard.CommentOn():
                self._comment_on(message)
            case heard.AddParticipants():
                self._begin(self._add(message))
            case heard.ListResults():
                self._begin(self._tell_results(message))

    def show_scene(self, name: str, stage: Stage) -> None:
        """Something is worked on from now on at the station that is watched."""
        self._named = None
        self._flying.clear()
        console = stage.console
        self._meshes.begin(console)
        self.sender.say(SceneMessage.of(name, console, stage.command, stage.start, ALL_GUIDES))
        if self._meshes_wanted:
            self._begin(self._bring_meshes(stage))

    async def _bring_meshes(self, stage: Stage) -> None:
        """Send a scene's surfaces once they are made, where it is still the one that is watched."""
        try:
            geometry = await asyncio.wrap_future(self._course.catalog.meshes(stage.scene))
        except (ValueError, OSError, ImportError, RuntimeError, MemoryError) as error:
            self.sender.report(f"the 3-D view has no surfaces: {error}")
            return
        working = None if self._watched is None else self._watched.working
        if working is None or working[1] is not stage or not self._meshes_wanted:
            return
        self.sender.put(geometry)
        self._meshes.show(stage.scene)
        self._seen = None  # where nothing moves, the positions come with the last picture once more
        if self._watched is not None and self._watched.seen is not None:
            self.show(self._watched.seen)

    def show(self, seen: Seen) -> None:
        """Send a picture of the station that is watched, where the page has drawn those before; in any thread."""
        with self._showing:
            if len(self._flying) >= _AHEAD or seen is self._seen:
                return
            self._frames += 1
            number, self._seen = self._frames, seen
            self._flying.append(number)
            positions = None if seen.replay else self._meshes.positions(seen.scene, seen.shown)
        shown = seen.shown
        picture = wire.frame(
            shown, number=number, seq=0, guides=ALL_GUIDES, summary=seen.summary, replay=seen.replay,
            positions=positions,
        )  # fmt: skip
        self.sender.call(lambda _: self._send(shown.model, shown.target, picture), None)

    def _drawn(self, frame: int) -> None:
        """There is room for another picture: for the newest, where it was left out."""
        while self._flying and self._flying[0] <= frame:
            self._flying.popleft()
        if self._watched is not None and self._watched.seen is not None:
            self.show(self._watched.seen)

    def _send(self, model: str, target: str, picture: bytes) -> None:
        if (model, target) != self._named:
            self._named = model, target
            self.sender.say(ModelMessage(model=model))
            self.sender.say(TargetMessage(id=target))
        self.sender.put(picture)

    def _watch(self, station: Station | None, meshes: bool = False) -> None:
        self._meshes_wanted = meshes
        if self._watched is not None:
            self._watched.watchers -= {self}
        self._watched = station
        if station is None:
            return
        station.watchers |= {self}
        if station.working is not None:
            self.show_scene(*station.working)
        if station.seen is not None:
            self.show(station.seen)

    def _set_exercise(self, message: heard.SetExercise) -> None:
        known = self._course.catalog.exercises.entries
        if message.exercise is not None and message.exercise not in known:
            names = ", ".join(known)
            raise MessageError(
                "set_exercise", f"exercise = {message.exercise[:40]!r} is not known; choose one of {names}"
            )
        for station in self._stations("set_exercise", message.station):
            station.set_exercise(message.exercise)

    def _comment_on(self, message: heard.CommentOn) -> None:
        try:
            text = check_comment(message.text)
        except ValueError as error:
            raise MessageError("comment_on", str(error)) from None
        self._station("comment_on", message.station).comment(message.time_s, text)

    def _stations(self, what: str, name: str | None) -> tuple[Station, ...]:
        return tuple(self._course.stations.values()) if name is None else (self._station(what, name),)

    def _station(self, what: str, name: str) -> Station:
        station = self._course.stations.get(name)
        if station is None:
            raise MessageError(
                what, f"station = {name[:20]!r} is not here; give one of {', '.join(self._course.stations)}"
            )
        return station

    async def _look(self) -> None:
        """Say how the stations stand whenever that has changed, and show small pictures of them."""
        said, shown = None, dict.fromkeys(self._course.stations, 0)
        looks = 0
        while True:
            states = tuple(state_of(station) for station in self._course.stations.values())
            keeper = self._course.keeper
            now = heard.Stations(stations=states, waiting=keeper.waiting, problem=keeper.problem)
            if now != said:
                self.sender.say(now)
                said = now
            if looks % _THUMBS == 0:
                await self._show_small(shown)
            looks += 1
            await asyncio.sleep(_LOOK_S)

    async def _show_small(self, shown: dict[str, int]) -> None:
        """Show who looks other than in ``shown``, in its order, while the page reads; those left out come first."""
        for name in tuple(shown):
            seen = self._course.stations[name].seen
            if seen is None or seen.frame == shown[name]:
                continue
            await asyncio.sleep(0)  # what was said leaves
            if not self._outbox.is_empty:
                return
            del shown[name]
            shown[name] = seen.frame
            self.sender.put(thumb(name, seen.shown))

    async def _add(self, message: heard.AddParticipants) -> None:
        with self._refusing("add_participants"):
            await asyncio.to_thread(self._course.store.add_participants, message.codes, group=message.group)
            await self._tell_results(heard.ListResults(today=False, exercise=None))

    async def _tell_results(self, message: heard.ListResults) -> None:
        with self._refusing("list_results"):
            found = await asyncio.to_thread(self._course.results, today=message.today, exercise=message.exercise)
            self.sender.say(found)

    @contextlib.contextmanager
    def _refusing(self, what: str) -> Iterator[None]:
        try:
            yield
        except (ValueError, LabDatabaseError) as error:
            self._refuse(what, str(error))

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

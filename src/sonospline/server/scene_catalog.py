"""The scenes a server offers, each made once and shared by its sessions."""

from __future__ import annotations

import contextlib
import logging
import secrets
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from .. import simulator
from ..simulator.shipped import SHIPPED
from . import wire
from .exercise_catalog import ExerciseCatalog
from .memory_release import release_memory
from .server_messages import PROTOCOL, Hello, OfferedScene
from .worker import Worker

if TYPE_CHECKING:
    from ..simulator.console import Console
    from ..simulator.scene import Scene
    from ..simulator.scene_file import SceneFile
    from .live_attempt import LiveAttempt
    from .practice import Practice

Progress = Callable[[float], None]
Wanted = Callable[[], bool]

logger = logging.getLogger(__name__)

_KEPT = 2
"""Worlds kept: one may be hundreds of megabytes."""


@dataclass(frozen=True)
class Entry:
    """A scene on offer."""

    spec: SceneFile
    folder: Path


class SceneCatalog:
    """Scenes by their id.

    Parameters
    ----------
    own : mapping of str to Entry, optional
        Scenes of the user's, before the shipped ones.
    first : str, optional
        The scene a new page shows; by default the first.
    exercises : ExerciseCatalog, optional
        Exercises; by default the shipped ones.
    """

    def __init__(
        self, own: dict[str, Entry] | None = None, *, first: str | None = None,
        exercises: ExerciseCatalog | None = None,
    ) -> None:  # fmt: skip
        self._own = own or {}
        self.exercises = ExerciseCatalog() if exercises is None else exercises
        self.first = next(iter((*self._own, *SHIPPED))) if first is None else first
        self._made: OrderedDict[tuple[bytes, Path], Scene] = OrderedDict()
        self._prepared: Practice | None = None
        self._waiting: list[Progress] = []
        # Scenes are made one after the other: two at once would take the machine from sessions that run. But what a
        # page brings along may take long, and holds up nobody who wants a scene on offer.
        self._offered, self._brought = Worker("sonospline-scenes"), Worker("sonospline-brought-scenes")
        self._releasing: Future[None] | None = None
        self._brought_scenes: weakref.WeakSet[Scene] = weakref.WeakSet()

    @cached_property
    def scenes(self) -> dict[str, Entry]:
        """Those on offer by their id; shipped ones are read when somebody asks, since models load with them."""
        shipped = {name: Entry(simulator.SceneFile.shipped(name), Path()) for name in SHIPPED if name not in self._own}
        return {**self._own, **shipped}

    def hello(self, key: str, *, resumed: bool) -> Hello:
        """Return the greeting of a session, with the key it can be asked back by."""
        scenes = tuple(
            OfferedScene(id=key, name=entry.spec.name, description=entry.spec.description)
            for key, entry in self.scenes.items()
        )
        return Hello(version=version("sonospline"), protocol=PROTOCOL, scenes=scenes, session=key, resumed=resumed)

    def title(self, name: str) -> str:
        """Return what a scene calls itself; of a file that was not read yet, its name."""
        return self.scenes[name].spec.name if name in self.scenes else name

    def prepare(self) -> None:
        """Begin to make the first scene and its first picture before anybody asks."""
        self._offered.submit(self._prepare)

    def order(self, name: str, text: str | None, progress: Progress, wanted: Wanted = lambda: True) -> Future[Practice]:
        """Return free practice on a scene, its first picture made, once it is there.

        Parameters
        ----------
        name : str
            Id of a scene on offer, or the name of the file ``text`` is from.
        text : str or None
            A scene file from outside: files it names must lie in the folder the server was started in.
        progress : callable
            Called with the share done, from another thread.
        wanted : callable, optional
            Asked now and then; the work is dropped when it says no.

        Raises
        ------
        ValueError
            By the future: a scene that cannot be made.
        """
        if text is not None:
            return self._brought.submit(self._make_brought, name, text, progress, wanted)
        self._waiting.append(progress)
        future = self._offered.submit(self._deliver, name, progress)
        future.add_done_callback(lambda done: self._waiting.remove(progress) if progress in self._waiting else None)
        return future

    def order_attempt(self, name: str, seed: int | None, progress: Progress) -> Future[LiveAttempt]:
        """Return an attempt at an exercise on offer, its first picture made, once it is there.

        Parameters
        ----------
        name : str
            Id of the exercise.
        seed : int, optional
            Of its start; by default drawn.
        progress : callable
            Called with the share done, from another thread.

        Raises
        ------
        ValueError
            By the future: an exercise that does not fit its scene, or a scene that cannot be made.
        """
        return self._offered.submit(self._begin, name, secrets.randbelow(2**32) if seed is None else seed, progress)

    def geometry(self, console: Console, wanted: Wanted = lambda: True) -> Future[bytes]:
        """Return the message with a scene's meshes, once they are made; then make ready what comes next."""
        made = self.meshes(console.scene)
        self.prepare_push(console, wanted)
        return made

    def meshes(self, scene: Scene) -> Future[bytes]:
        """Return the message with a scene's meshes, once they are made."""
        return self._worker_of(scene).submit(wire.geometry, scene)

    def prepare_push(self, console: Console, wanted: Wanted = lambda: True) -> None:
        """Make what a push will need."""
        worker = self._worker_of(console.scene)
        for preparation in (console.warm_up, console.scene.prepare):
            worker.submit(_if_wanted, wanted, preparation)

    def _worker_of(self, scene: Scene) -> Worker:
        return self._brought if scene in self._brought_scenes else self._offered

    def release_memory(self) -> None:
        """Give back the memory of sessions that ended, in a thread that makes scenes."""
        if self._releasing is None or self._releasing.done():
            with contextlib.suppress(RuntimeError):  # closed: the process ends anyway
                self._releasing = self._offered.submit(release_memory)

    def close(self, within_s: float = 2.0) -> bool:
        """Drop what waits, and wait a while for what is in work; return whether all of it has ended."""
        end = time.monotonic() + within_s
        ended = [worker.close(max(0.0, end - time.monotonic())) for worker in (self._offered, self._brought)]
        self.exercises.close()
        return all(ended)

    def _prepare(self) -> None:
        try:
            self._prepared = _practice(self._scene(self.scenes[self.first], self._pass_on), self._pass_on)
        except Exception as error:  # said to the first page that asks
            logger.warning("scene %s could not be made: %s", self.first, error)

    def _pass_on(self, share: float) -> None:
        for progress in tuple(self._waiting):
            progress(share)

    def _deliver(self, name: str, progress: Progress) -> Practice:
        self._waiting.remove(progress)
        if name == self.first and self._prepared is not None:
            prepared, self._prepared = self._prepared, None
            return prepared
        return _practice(self._scene(self.scenes[name], progress), progress)

    def _begin(self, name: str, seed: int, progress: Progress) -> LiveAttempt:
        from .live_attempt import LiveAttempt

        entry = self.exercises.entries[name]
        exercise, folder = entry.exercise, entry.folder
        scene = self._scene(Entry(exercise.scene_file(folder), folder), progress)
        attempt = LiveAttempt(name, exercise, scene, seed, self.exercises.recordings.new(name, seed))
        progress(1.0)
        return attempt

    def _scene(self, entry: Entry, progress: Progress) -> Scene:
        """The scene of a file; exercises in one scene share it."""
        from ..simulator.scene_maker import make_scene

        key = msgspec.json.encode(entry.spec), entry.folder
        if key not in self._made:
            self._made[key] = make_scene(entry.spec, folder=entry.folder, progress=progress)
        self._made.move_to_end(key)
        while len(self._made) > _KEPT:
            self._made.popitem(last=False)
        return self._made[key]

    def _make_brought(self, name: str, text: str, progress: Progress, wanted: Wanted) -> Practice:
        from ..simulator.scene_maker import make_scene
        from .file_access import refuse_elsewhere

        def go_on(share: float) -> None:
            if not wanted():
                raise DroppedError(f"{name} is not wanted any more")
            progress(share)

        go_on(0.0)
        spec = simulator.SceneFile.parse(text, file=name)
        refuse_elsewhere(spec)
        scene = make_scene(spec, progress=go_on)
        self._brought_scenes.add(scene)
        return _practice(scene, go_on)


class DroppedError(Exception):
    """Whoever asked for a scene has left before it was made."""


def _if_wanted(wanted: Wanted, preparation: Callable[[], None]) -> None:
    if not wanted():
        return
    try:
        preparation()
    except Exception as error:  # said to the page at its first push; whoever brought the scene can know now
        logger.warning("the scene cannot be made ready for a push: %s", error)


def _practice(scene: Scene, progress: Progress) -> Practice:
    from ..simulator.console import Console  # here, so that the page can be opened before it is loaded
    from ..simulator.session import Session
    from .practice import Practice

    practice = Practice(Console(Session(scene)))
    practice.step()
    progress(1.0)
    return practice

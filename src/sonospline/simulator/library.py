"""The scenes a server offers, each made once and shared by its sessions."""

from __future__ import annotations

import contextlib
import logging
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import wire
from .scene_file import SHIPPED, SceneFile
from .tidying import tidy

if TYPE_CHECKING:
    from .session import Session
    from .world import World

Progress = Callable[[float], None]

logger = logging.getLogger(__name__)

_KEPT = 2
"""Worlds kept: one may be hundreds of megabytes."""


@dataclass(frozen=True)
class Entry:
    """A scene on offer."""

    spec: SceneFile
    folder: Path


class Library:
    """Scenes by their id.

    Parameters
    ----------
    own : mapping of str to Entry, optional
        Scenes of the user's, before the shipped ones.
    first : str, optional
        The scene a new page shows; by default the first.
    """

    def __init__(self, own: dict[str, Entry] | None = None, *, first: str | None = None) -> None:
        shipped = {name: Entry(SceneFile.shipped(name), Path()) for name in SHIPPED}
        self.scenes: dict[str, Entry] = {**(own or {}), **{k: v for k, v in shipped.items() if k not in (own or {})}}
        self.first = next(iter(self.scenes)) if first is None else first
        self._worlds: OrderedDict[str, World] = OrderedDict()
        self._prepared: Session | None = None
        self._waiting: list[Progress] = []
        # One thread makes scenes, one after the other: two at once would take the machine from sessions that run.
        self._maker = ThreadPoolExecutor(1, "sonospline-scenes")

    def hello(self) -> dict[str, Any]:
        """Return the greeting."""
        scenes = [
            {"id": key, "name": entry.spec.name, "description": entry.spec.description}
            for key, entry in self.scenes.items()
        ]
        return wire.hello(version("sonospline"), scenes, self.first)

    def title(self, name: str) -> str:
        """Return what a scene calls itself; of a file that was not read yet, its name."""
        return self.scenes[name].spec.name if name in self.scenes else name

    def prepare(self) -> None:
        """Begin to make the first scene and its first picture before anybody asks."""
        self._maker.submit(self._prepare)

    def order(self, name: str, text: str | None, progress: Progress) -> Future[Session]:
        """Return a new session of a scene, its first picture made, once it is there.

        Parameters
        ----------
        name : str
            Id of a scene on offer, or the name of the file ``text`` is from.
        text : str or None
            A scene file from outside: files it names must lie in the folder the server was started in.
        progress : callable
            Told the share done, from another thread.

        Raises
        ------
        ValueError
            By the future: a scene that cannot be made.
        """
        self._waiting.append(progress)
        future = self._maker.submit(self._deliver, name, text, progress)
        future.add_done_callback(lambda done: self._waiting.remove(progress) if progress in self._waiting else None)
        return future

    def geometry(self, world: World) -> Future[bytes]:
        """Return the message with a scene's meshes, once they are made; then make the rest of the scene."""
        made = self._maker.submit(wire.geometry, world)
        self._maker.submit(world.prepare)
        return made

    def tidy(self) -> None:
        """Give back the memory of sessions that ended, in the thread that makes scenes."""
        with contextlib.suppress(RuntimeError):  # closed: the process ends anyway
            self._maker.submit(tidy)

    def close(self) -> None:
        """End the thread that makes scenes, once the one in work is made."""
        self._maker.shutdown(cancel_futures=True)

    def _prepare(self) -> None:
        try:
            self._prepared = self._make(self.first, None, self._pass_on)
        except Exception as error:  # the first page is told why, when it asks
            logger.warning("scene %s could not be made: %s", self.first, error)

    def _pass_on(self, share: float) -> None:
        for progress in tuple(self._waiting):
            progress(share)

    def _deliver(self, name: str, text: str | None, progress: Progress) -> Session:
        self._waiting.remove(progress)
        if text is None and name == self.first and self._prepared is not None:
            prepared, self._prepared = self._prepared, None
            return prepared
        return self._make(name, text, progress)

    def _make(self, name: str, text: str | None, progress: Progress) -> Session:
        from .session import Session  # here, so that the page can be opened before it is loaded

        session = Session(self._world(name, text, progress))
        session.step()
        progress(1.0)
        return session

    def _world(self, name: str, text: str | None, progress: Progress) -> World:
        from .world import World

        if text is not None:
            spec = SceneFile.parse(text, file=name)
            _refuse_elsewhere(spec)
            return World.make(spec, progress=progress)
        if name not in self._worlds:
            entry = self.scenes[name]
            self._worlds[name] = World.make(entry.spec, folder=entry.folder, progress=progress)
        self._worlds.move_to_end(name)
        while len(self._worlds) > _KEPT:
            self._worlds.popitem(last=False)
        return self._worlds[name]


def _refuse_elsewhere(spec: SceneFile) -> None:
    here = Path().resolve()
    for key in ("file", "names", "ct", "materials"):
        named = getattr(spec.tissue, key)
        if named is not None and not (here / named).resolve().is_relative_to(here):
            raise ValueError(
                f"tissue.{key} = {named!r} lies outside the folder the server was started in; start it with --scene"
            )

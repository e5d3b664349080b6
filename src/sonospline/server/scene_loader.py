"""Scenes on their way to one page, one at a time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Protocol

from .. import simulator
from .client_messages import MessageError
from .scene_catalog import SceneCatalog
from .sender import Sender
from .server_messages import Loading

if TYPE_CHECKING:
    from ..simulator.console import Console

logger = logging.getLogger(__name__)


class Refuse(Protocol):
    """Says why a scene was not loaded."""

    def __call__(self, what: str, problem: str, *, file: str | None = None, line: int | None = None) -> None: ...


class SceneLoader:
    """Orders sessions of scenes, tells the page how far they are, and refuses what cannot be made.

    Parameters
    ----------
    catalog : SceneCatalog
        Scenes.
    sender : Sender
        Who says what to the page.
    refuse : callable
        Called with what is wrong.
    ready : coroutine function
        Called with the id of a scene and its session, once it is made.
    """

    def __init__(
        self, catalog: SceneCatalog, sender: Sender, refuse: Refuse, ready: Callable[[str, Console], Awaitable[None]]
    ) -> None:
        self._catalog, self._sender, self._refuse, self._ready = catalog, sender, refuse, ready
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    @property
    def busy(self) -> bool:
        """Whether a scene is being made."""
        return self._task is not None and not self._task.done()

    def load(self, name: str, text: str | None = None) -> None:
        """Begin to load a scene on offer, or one of a file's text.

        Raises
        ------
        MessageError
            Another one is loading.
        """
        if self.busy:
            raise MessageError("scene", "came while another one is loading; wait for it")
        self._sender.say(self._progress(name, 0.0))
        self._task = asyncio.create_task(self._bring(name, text))

    async def close(self) -> None:
        """Want no scene any more."""
        self._closed = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _bring(self, name: str, text: str | None) -> None:
        file = name if text is not None else None
        try:
            ordered = self._catalog.order(
                name, text, lambda share: self._sender.say_from_thread(self._progress(name, share)),
                lambda: not self._closed,
            )  # fmt: skip
            console = await asyncio.wrap_future(ordered)
        except simulator.SceneError as error:
            self._refuse("scene", error.problem, file=error.file, line=error.line)
        except (ValueError, OSError, ImportError, MemoryError) as error:
            self._refuse("scene", str(error), file=file)
        except Exception as error:
            logger.exception("scene %s could not be made", name)
            self._refuse("scene", f"could not be made ({error})", file=file)
        else:
            await self._ready(name, console)

    def _progress(self, name: str, share: float) -> Loading:
        return Loading(scene=name, name=self._catalog.title(name), share=share)

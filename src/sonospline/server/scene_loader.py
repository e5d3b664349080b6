"""Scenes on their way to one page, one at a time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Protocol

from .. import simulator
from .client_messages import MessageError
from .scene_catalog import SceneCatalog
from .sender import Sender
from .server_messages import Loading

if TYPE_CHECKING:
    from .stage import Stage

logger = logging.getLogger(__name__)

Order = Callable[[Callable[[float], None]], Future[Any]]
"""Orders something, with what is to be called with the share done."""


class Refuse(Protocol):
    """Says why a scene was not loaded."""

    def __call__(self, what: str, problem: str, *, file: str | None = None, line: int | None = None) -> None: ...


class SceneLoader:
    """Orders practice and attempts, tells the page how far they are, and refuses what cannot be made.

    Parameters
    ----------
    catalog : SceneCatalog
        Scenes.
    sender : Sender
        Who says what to the page.
    refuse : callable
        Called with what is wrong.
    ready : coroutine function
        Called with the id of a scene or an exercise and what a page works on, once it is made.
    """

    def __init__(
        self, catalog: SceneCatalog, sender: Sender, refuse: Refuse, ready: Callable[[str, Stage], Awaitable[None]]
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
        self._start(
            "scene",
            name,
            self._catalog.title(name),
            name if text is not None else None,
            lambda progress: self._catalog.order(name, text, progress, lambda: not self._closed),
        )

    def attempt(self, name: str, seed: int | None) -> None:
        """Begin to make an attempt at an exercise on offer.

        Raises
        ------
        MessageError
            Something else is loading.
        """
        title = self._catalog.exercises.entries[name].exercise.name
        self._start(
            "begin_attempt", name, title, None, lambda progress: self._catalog.order_attempt(name, seed, progress)
        )

    async def close(self) -> None:
        """Want no scene any more."""
        self._closed = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def _start(self, what: str, name: str, title: str, file: str | None, order: Order) -> None:
        if self.busy:
            raise MessageError(what, "came while a scene is loading; wait for it")

        def said(share: float) -> Loading:
            return Loading(scene=name, name=title, share=share)

        self._sender.say(said(0.0))
        self._task = asyncio.create_task(
            self._bring(what, name, file, lambda: order(lambda share: self._sender.say_from_thread(said(share))))
        )

    async def _bring(self, what: str, name: str, file: str | None, order: Callable[[], Future[Any]]) -> None:
        try:
            ordered = order()
            stage = await asyncio.wrap_future(ordered)
        except asyncio.CancelledError:
            ordered.add_done_callback(_close)  # what is in work is made all the same
            raise
        except simulator.SceneError as error:
            self._refuse(what, error.problem, file=error.file, line=error.line)
        except (ValueError, OSError, ImportError, MemoryError) as error:
            self._refuse(what, str(error), file=file)
        except Exception as error:
            logger.exception("scene %s could not be made", name)
            self._refuse(what, f"could not be made ({error})", file=file)
        else:
            try:
                await self._ready(name, stage)
            except asyncio.CancelledError:  # nobody has taken it
                stage.close()
                raise


def _close(made: Future[Any]) -> None:
    """End what nobody takes any more: an attempt has begun to be written down."""
    if not made.cancelled() and made.exception() is None:
        made.result().close()

"""A thread that does jobs one after the other."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import Any, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")


class Worker:
    """Jobs in order, in one thread that does not keep the process from ending.

    Unlike an executor's thread it is a daemon: nobody can stop a job that reads a file or factors a matrix, and a
    server that is asked to end shall end all the same.

    Examples
    --------
    >>> from sonospline.server.worker import Worker
    >>> worker = Worker("sums")
    >>> worker.submit(sum, (1, 2, 3)).result()
    6
    >>> worker.close(within_s=1.0)
    True
    """

    def __init__(self, name: str) -> None:
        self._jobs: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._lock = threading.Lock()
        self._closed = False

    def submit(self, job: Callable[P, T], *args: P.args, **options: P.kwargs) -> Future[T]:
        """Return the result of a job, once it was its turn; a job that is cancelled before is left out.

        Raises
        ------
        RuntimeError
            The worker is closed.
        """
        future: Future[T] = Future()
        with self._lock:
            if self._closed:
                raise RuntimeError(f"{self._thread.name} is closed")
            if self._thread.ident is None:
                self._thread.start()
            self._jobs.put((future, lambda: job(*args, **options)))
        return future

    def close(self, within_s: float) -> bool:
        """Leave out what waits and end; return whether the job in work ended in time."""
        with self._lock:
            self._closed = True
            while True:
                try:
                    item = self._jobs.get_nowait()
                except Empty:
                    break
                if item is not None:
                    item[0].cancel()
            self._jobs.put(None)
        if self._thread.ident is not None:
            self._thread.join(within_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (item := self._jobs.get()) is not None:
            future, job = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(job())
            except BaseException as error:  # for whoever waits for it
                future.set_exception(error)
            del item, future, job  # a session shall not live on in a thread that waits

"""Evaluating many designs at once: in processes of this machine, or on any executor."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._extras import require

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

_held: Function | None = None
"""In a worker process: the function it evaluates."""


@contextmanager
def rows_in_parallel(function: Function, *, workers: int, executor: Executor | None = None) -> Iterator[Function]:
    """Yield a function that applies ``function`` to every row of an array, in parallel.

    The results and their order do not depend on the number of workers.

    Parameters
    ----------
    function : callable
        Takes one row, returns an array; can be pickled.
    workers : int
        Processes to start, or parts to cut the rows into for ``executor``.
    executor : Executor, optional
        Any of :mod:`concurrent.futures` or like them. Each part carries the function with
        it. By default processes of this machine, which receive it once.
    """
    if executor is not None:
        yield lambda rows: _on_executor(executor, function, rows, workers)
        return
    # A forked child inherits the core's threads in an unknown state, so workers start afresh.
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_hold, initargs=(function,)) as pool:
        yield lambda rows: np.array(list(pool.map(_evaluate_held, rows)))


ANSWER_S = 5.0
"""A scheduler answers within that."""


@contextmanager
def dask_executor(address: str) -> Iterator[tuple[Executor, int]]:
    """Yield an executor on a Dask cluster, and its number of threads.

    Parameters
    ----------
    address : str
        Of its scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    ValueError
        Nobody answers there.
    MissingExtraError
        ``distributed`` is not installed.
    """
    distributed = require("distributed")
    comm, registry = require("distributed.comm"), require("distributed.comm.registry")
    try:
        registry.get_backend(comm.parse_address(address)[0])  # a client refused halfway takes seconds to close
        client = distributed.Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"dask address = {address!r} does not answer ({_first_line(error)}); give a running scheduler's"
        ) from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise ValueError(f"dask address = {address!r} has no workers; start some and try again")
        yield client.get_executor(), threads


def usable_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _on_executor(executor: Executor, function: Function, rows: Array, parts: int) -> Array:
    pieces = np.array_split(rows, min(parts, len(rows)))
    futures = [executor.submit(_evaluate_rows, function, piece) for piece in pieces]
    return np.concatenate([future.result() for future in futures])


def _evaluate_rows(function: Function, rows: Array) -> Array:
    return np.array([function(row) for row in rows])


def _hold(function: Function) -> None:
    """Keep the function in this worker, and the core on one thread: the processes share the processors."""
    global _held
    _held = function
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process; the one that started us decides
    if _core.native is not None:
        _core.native.set_thread_count(1)
    Thread(target=_leave_with_the_parent, daemon=True).start()


def _leave_with_the_parent() -> None:
    """End this worker when the process that started it is gone: killed, it can tell nobody."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _evaluate_held(row: Array) -> Array:
    assert _held is not None
    return _held(row)


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0] or type(error).__name__

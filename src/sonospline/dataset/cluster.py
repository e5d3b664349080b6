"""Dask: a cluster of this machine's processes, or one that is there, and shards made on it a few at a time."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from .._extras import require
from .provenance import Provenance, difference, provenance
from .shard import Job, Receipt, WorkerError, make_shard

ANSWER_S = 10.0
"""A scheduler answers within that."""
_CORE = ("backend", "instruction_set", "core")
WORKERS_S = 60.0
"""Workers come within that."""
_KILLED = 8
"""Times that the workers of one shard may be killed."""
_ONE_THREAD = ("SONOSPLINE_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "ZARR_THREADING__MAX_WORKERS")
_ENVIRONMENT = dict.fromkeys(_ONE_THREAD, "1")
_LEAN = {
    "distributed.admin.tick.interval": "500ms", "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.log-length": 720, "distributed.admin.log-length": 100,
    "distributed.admin.low-level-log-length": 100, "distributed.worker.profile.enabled": False,
    "distributed.nanny.pre-spawn-environ": _ENVIRONMENT,
}  # fmt: skip
"""Of a cluster of this machine: looking after itself 50 times a second costs a tenth of a core, its logs megabytes; and
the MALLOC_TRIM_THRESHOLD_ that nannies set has every array's pages given back and faulted in again: a quarter more.
"""


@contextmanager
def cluster(workers: int, scheduler: str | None, say: Callable[[str], None]) -> Iterator[Any]:
    """Yield a client of a cluster: of so many processes of this machine, or of a scheduler's workers.

    Raises
    ------
    ValueError
        Nobody answers at the address.
    RuntimeError
        The scheduler is of another version, or has no workers.
    MissingExtraError
        ``pip install 'sonospline[data]'``.
    """
    distributed = require("distributed")
    if scheduler is None:
        with (
            _unsaid(),
            require("dask").config.set(_LEAN),
            distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, env=_ENVIRONMENT, silence_logs=50,
                dashboard_address=":0",
            ) as local,
            distributed.Client(local, set_as_default=False) as client,
        ):  # fmt: skip
            say(f"dashboard     {client.dashboard_link}")
            yield client
        return
    with _unsaid(), _connected(distributed, scheduler) as client:
        _check_scheduler(client, scheduler)
        say(f"dashboard     {client.dashboard_link}")
        yield client


@contextmanager
def _unsaid() -> Iterator[None]:
    """Keep Dask's own log from telling what an error will say in one line."""
    loggers = [logging.getLogger(name) for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


@contextmanager
def _connected(distributed: Any, address: str) -> Iterator[Any]:
    comm, registry = require("distributed.comm"), require("distributed.comm.registry")
    try:
        registry.get_backend(comm.parse_address(address)[0])
        client = distributed.Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        why = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"scheduler = {address!r} does not answer ({why}); give a running scheduler's") from None
    with client:
        yield client


def _check_scheduler(client: Any, address: str) -> None:
    found = client.get_versions(check=False)
    ours, theirs = found["client"]["packages"], found["scheduler"]["packages"]
    for name in ("distributed", "dask", "msgpack"):
        if ours.get(name) != theirs.get(name):
            raise RuntimeError(
                f"scheduler = {address!r} has {name} {theirs.get(name)} and this machine {ours.get(name)}; install the "
                "same on both"
            )


def made_on(client: Any) -> Provenance:
    """Return what the workers of a cluster make samples with, all alike and like this process.

    Raises
    ------
    WorkerError
        A worker lacks this package or its core, or has another version.
    RuntimeError
        There are no workers.
    """
    distributed = require("distributed")
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except (TimeoutError, distributed.TimeoutError):
        raise RuntimeError(f"the scheduler has no workers after {WORKERS_S:.0f} s; start some and try again") from None
    ours = provenance()
    found = client.run(provenance, on_error="return")
    theirs = next((one for one in found.values() if not isinstance(one, BaseException)), ours)
    for address, one in sorted(found.items()):
        if isinstance(one, BaseException):
            why = " ".join(str(one).split())[:200]
            raise WorkerError(f"worker {address} cannot run sonospline ({why}); install the same version there")
        # the workers' core counts, and may be another than this machine's
        free = () if address == next(iter(found)) else ("backend", "instruction_set")
        wanted = {**ours, **{name: theirs[name] for name in _CORE}}
        differs = difference(wanted, one)
        if differs:
            core = "; build the core there" if free and one["backend"] == "numpy" else ""
            raise WorkerError(f"worker {address} would make other bits: its {differs}{core}; give all the same")
    if theirs["backend"] == "numpy" and ours["backend"] == "core":
        raise WorkerError(
            f"the workers run without the compiled core, {ours['instruction_set']} here; build it there, or set "
            "SONOSPLINE_BACKEND=numpy here, too"
        )
    return theirs


def made_by_workers(client: Any, job: Job, shards: list[int]) -> Iterator[Receipt]:
    """Yield the receipt of each shard as it is made; no more are asked for at a time than workers can begin.

    Raises
    ------
    StoreError, WorkerError
        As :func:`~sonospline.dataset.shard.make_shard`.
    RuntimeError
        The scheduler went away, or the workers of a shard were killed again and again.
    """
    distributed = require("distributed")
    waiting, running, killed = iter(shards), {}, dict[int, int]()
    done = distributed.as_completed(loop=client.loop)

    def ask(shard: int) -> None:
        future = client.submit(make_shard, job, shard, pure=False, retries=0)
        running[future] = shard
        done.add(future)

    def feed() -> None:
        room = 2 * sum(client.nthreads().values()) + 2 - len(running)
        for _ in range(max(room, 0)):
            shard = next(waiting, None)
            if shard is None:
                return
            ask(shard)

    try:
        feed()
        for future in done:
            shard = running.pop(future)
            try:
                receipt = future.result()
            except distributed.KilledWorker:
                killed[shard] = killed.get(shard, 0) + 1
                if killed[shard] > _KILLED:
                    raise RuntimeError(
                        f"the workers that made shard {shard} were killed {killed[shard]} times; give them more memory"
                    ) from None
                ask(shard)
                continue
            except ModuleNotFoundError as error:
                raise WorkerError(f"a worker cannot run sonospline ({error}); install the same version there") from None
            future.release()
            yield receipt
            feed()
    except (distributed.CancelledError, distributed.comm.CommClosedError, TimeoutError) as error:
        why = " ".join(str(error).split())[:100] or type(error).__name__
        raise RuntimeError(
            f"the scheduler went away ({why}); what is made stays: run the same again to make the rest"
        ) from None
    finally:
        for future in running:
            future.cancel()

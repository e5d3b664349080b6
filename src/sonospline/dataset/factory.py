"""Makes a data set: plans it, makes the shards that are missing, here or on a cluster, and writes the manifest."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._digest import digest
from .cluster import cluster, made_on
from .finish import finish
from .layout import FORMAT, FORMAT_VERSION, PLAN, read_described, receipt_name
from .plan import Plan
from .provenance import Provenance, difference, provenance
from .shard import Job, Receipt, WorkerError, make_shard
from .source import Origin
from .specification import Specification
from .store import Store, store_at

Progress = Callable[[int, int, int], None]
"""Called with samples made, samples in all, and how many failed."""

_ENOUGH = 4
"""Shards without a single sample that end a run."""


@dataclass(frozen=True, kw_only=True)
class Made:
    """What a run has made."""

    samples: int
    failed: dict[int, str]
    """Samples that could not be made, and why."""
    made: int
    """Samples of this run; the others were there."""
    bytes: int
    """Of all shards."""
    hash: str
    """Of all their files, as the manifest has it."""

    @property
    def bytes_a_sample(self) -> float:
        """Length of the shards over the samples."""
        return self.bytes / self.samples


def make_dataset(
    asked: Specification,
    out: str | os.PathLike[str],
    *,
    workers: int = 1,
    scheduler: str | None = None,
    client: Any = None,
    options: dict[str, Any] | None = None,
    recipes: Store | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> Made:
    """Make a data set, or what is missing of it.

    The bits depend on the specification alone, and on what ``plan.json`` names (versions, instruction set): not on
    the number of workers, nor on their order, nor on how often a run was killed and started again.

    Parameters
    ----------
    asked : Specification
        What is asked for.
    out : str or path
        A folder, or an address of fsspec.
    workers : int, default: 1
        Processes of this machine; 1 makes everything in this one.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers make it.
    client : distributed.Client, optional
        A cluster that is there already.
    options : dict, optional
        For fsspec.
    recipes : Store, optional
        A data set whose recipes are taken.
    progress, say : callable, optional
        Called with samples made, all, and failed; with lines for whoever is watching.

    Raises
    ------
    ValueError
        A specification whose ranges leave the tissue, a source that cannot be read, or another data set in ``out``.
    StoreError
        The files cannot be written; what is whole stays, and the next run goes on from there.
    RuntimeError
        A cluster that went away, workers that would make other bits, or not one sample that can be made.

    Examples
    --------
    >>> import tempfile
    >>> from sonospline.dataset import Specification, make_dataset
    >>> asked = Specification.parse('''samples = 4
    ... [[sources]]
    ... kind = "block"
    ... [storage]
    ... form = "recipe"
    ... ''')
    >>> made = make_dataset(asked, tempfile.mkdtemp())
    >>> made.samples, made.made, made.failed
    (4, 4, {})
    """
    plan = Plan(asked)
    labels, sources = plan.labels_and_hashes()
    plan.check()
    place = store_at(out, options)
    say = say or (lambda text: None)
    with _client(client, workers, scheduler, say) as at:
        made_by = provenance() if at is None else made_on(at)
        if recipes is not None:
            _check_recipes(recipes, sources, made_by)
        claimed = _claim(place, plan, labels, sources, made_by)
        beams = _beams(plan)
        job = Job(plan=plan, place=place, labels=labels, sources=sources, made_by=made_by, beams=beams, recipes=recipes)
        place.remove_partial()
        receipts = {receipt.shard: receipt for receipt in whole_shards(place, asked)}
        missing = [shard for shard in range(asked.shards) if shard not in receipts]
        count = _Count(asked.samples, receipts.values(), progress)
        for receipt in _made(job, missing, at):
            receipts[receipt.shard] = receipt
            count.add(receipt)
            _stop_where_all_fail(list(receipts.values()), asked.shards)
    manifest = finish(job, claimed, [receipts[shard] for shard in range(asked.shards)])
    return Made(
        samples=asked.samples, failed=manifest["failed"], made=sum(len(job.numbers(shard)) for shard in missing),
        bytes=manifest["bytes"], hash=manifest["hash"],
    )  # fmt: skip


def _stop_where_all_fail(receipts: list[Receipt], shards: int) -> None:
    """What fails every sample of several shards is no sample's fault."""
    if len(receipts) >= min(_ENOUGH, shards) and all(len(one.failed) == one.samples for one in receipts):
        why = next(iter(receipts[0].failed.values()))
        raise RuntimeError(f"none of {sum(one.samples for one in receipts)} samples could be made: {why}")


def whole_shards(place: Store, asked: Specification) -> Iterator[Receipt]:
    """Yield the receipt of each shard that is there: its files of the right length, and at least one sample.

    One with samples that may not fail another time is to be made again.
    """
    for name in place.names("receipts"):
        try:
            receipt = Receipt.of(json.loads(place.read(name)))
        except ValueError:
            continue
        if name != receipt_name(receipt.shard) or receipt.shard >= asked.shards:
            continue
        whole = all(place.size(file) == size for file, (_, size) in receipt.files.items())
        if whole and receipt.final and len(receipt.failed) < receipt.samples:
            yield receipt


def _client(
    client: Any, workers: int, scheduler: str | None, say: Callable[[str], None]
) -> AbstractContextManager[Any]:
    if client is not None:
        return nullcontext(client)
    return nullcontext(None) if workers == 1 and scheduler is None else cluster(workers, scheduler, say)


def _made(job: Job, missing: list[int], client: Any) -> Iterable[Receipt]:
    if client is None:
        return (make_shard(job, shard) for shard in missing)
    from .cluster import made_by_workers

    return made_by_workers(client, job, missing)


def _check_recipes(recipes: Store, sources: Mapping[Origin, str], made_by: Provenance) -> None:
    """Raise where samples would come out otherwise than those that recipes were drawn for."""
    drawn = _read_plan(recipes)
    differs = difference(drawn["made_by"], made_by)
    if differs:
        raise WorkerError(f"samples would come out otherwise than the recipes': {differs}; make them with the same")
    if drawn["sources"] != digest(list(sources.values())):
        raise ValueError(f"recipes of {recipes.address!r} are of other label maps or scenes; bring those back")


def _claim(
    place: Store, plan: Plan, labels: dict[str, int], sources: Mapping[Origin, str], made_by: Provenance
) -> dict[str, Any]:
    """Write the plan, or check that the one that is there is this one; return it."""
    asked = {
        "format": FORMAT, "format_version": FORMAT_VERSION, "specification": plan.asked.as_table(),
        "digest": plan.asked.digest, "sources": digest(list(sources.values())), "labels": labels,
        "made_by": made_by,
    }  # fmt: skip
    if plan.asked.storage.names_of_files:
        asked["files"] = {hash_: Path(origin.file).name for origin, hash_ in sources.items() if origin.file is not None}
    if not place.holds(PLAN):
        if place.names(""):
            raise ValueError(f"out = {place.address!r} holds other files; give a new folder, or one of this data set")
        place.write(PLAN, json.dumps(asked, indent=1, sort_keys=True).encode())
        return asked
    found = _read_plan(place)
    if found["digest"] != asked["digest"]:
        raise ValueError(f"out = {place.address!r} holds another data set; give a new folder, or its specification")
    if found["sources"] != asked["sources"]:
        raise ValueError(f"out = {place.address!r} was made of other label maps or scenes; bring those back")
    differs = difference(found["made_by"], made_by)
    if differs:
        raise ValueError(f"out = {place.address!r} was begun elsewhere: here {differs}; go on there, or begin anew")
    return found


def _read_plan(place: Store) -> dict[str, Any]:
    return read_described(place, PLAN, f"is no data set: it has no {PLAN}; give a folder that make wrote")


def _beams(plan: Plan) -> tuple[int, int] | None:
    if not plan.asked.stored.iq:
        return None
    probe = plan.anatomy(0).probe
    return probe.lines, probe.samples


class _Count:
    """How far a run is, for whoever watches."""

    def __init__(self, samples: int, there: Iterable[Receipt], progress: Progress | None) -> None:
        self._samples, self._done, self._failed, self._progress = samples, 0, 0, progress
        for receipt in there:
            self._done += receipt.samples
            self._failed += len(receipt.failed)
        self._tell()

    def add(self, receipt: Receipt) -> None:
        self._done += receipt.samples
        self._failed += len(receipt.failed)
        self._tell()

    def _tell(self) -> None:
        if self._progress is not None:
            self._progress(self._done, self._samples, self._failed)

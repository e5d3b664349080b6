"""Makes one shard: its samples, their files, and at the end the receipt that says it is whole."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .._extras import MissingExtraError
from .layout import ArrayForm, array_forms, receipt_name, table_name, tar_name
from .plan import Plan
from .provenance import Provenance, difference, provenance
from .recipe import Recipe
from .sample import Sample, World
from .source import Origin, scene_of
from .source_files import files_of
from .store import Store
from .table_form import COLUMNS, RECIPE_COLUMNS, parquet, read_rows
from .tar_form import tar
from .zarr_form import shard_files

_LONGEST_REASON = 300
_KNOWN = (ValueError, RuntimeError)
"""What samples fail with that fail every time; else the next run tries again."""
_kept = threading.local()
"""In each thread: the last world, and what it is of."""


class WorkerError(RuntimeError):
    """A worker would make other bits than the rest."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Job:
    """All that a worker needs to make any shard of a data set."""

    plan: Plan
    place: Store
    labels: Mapping[str, int]
    sources: Mapping[Origin, str]
    """Hash of each source as it was planned."""
    made_by: Provenance
    beams: tuple[int, int] | None = None
    recipes: Store | None = None
    """A data set whose recipes are taken instead of drawn ones."""
    forms: Mapping[str, ArrayForm] = field(init=False)

    def __post_init__(self) -> None:
        recipe_only = self.plan.asked.storage.form == "recipe"
        object.__setattr__(self, "forms", {} if recipe_only else array_forms(self.plan.asked, self.beams))

    def numbers(self, shard: int) -> range:
        """Return the samples of a shard."""
        asked = self.plan.asked
        return range(shard * asked.shard, min((shard + 1) * asked.shard, asked.samples))


@dataclass(frozen=True, kw_only=True)
class Receipt:
    """What a shard holds: the hash and the length of each of its files, and which samples failed."""

    shard: int
    first: int
    samples: int
    files: Mapping[str, tuple[str, int]]
    failed: Mapping[int, str]
    final: bool = True
    """Whether those fail every time."""

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        files = {name: {"sha256": hash_, "bytes": size} for name, (hash_, size) in sorted(self.files.items())}
        failed = {str(index): reason for index, reason in sorted(self.failed.items())}
        return {
            "shard": self.shard, "first": self.first, "samples": self.samples, "files": files, "failed": failed,
            "final": self.final,
        }  # fmt: skip

    @classmethod
    def of(cls, held: Mapping[str, Any]) -> Receipt:
        """Return the receipt that JSON holds.

        Raises
        ------
        ValueError
            It holds none.
        """
        try:
            return cls(
                shard=int(held["shard"]), first=int(held["first"]), samples=int(held["samples"]),
                files={str(name): (str(f["sha256"]), int(f["bytes"])) for name, f in held["files"].items()},
                failed={int(index): str(reason) for index, reason in held["failed"].items()},
                final=bool(held.get("final", True)),
            )  # fmt: skip
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"receipt cannot be read ({error!r}); make the shard again") from None

    @property
    def bytes(self) -> int:
        """Length of its files together."""
        return sum(size for _, size in self.files.values())


def make_shard(job: Job, shard: int) -> Receipt:
    """Make a shard and store it.

    A sample that cannot be made is listed with its reason and does not stop the others; what is wrong with the
    machine or with a source does.

    Raises
    ------
    WorkerError
        This process would make other bits than the plan says, or reads other label maps or scenes.
    ValueError
        A source cannot be read.
    OSError, MemoryError
        The files cannot be written; or a fault of the machine, with which the next sample would fail, too.
    """
    check_worker(job.made_by)
    recipes = None if job.recipes is None else _recipes(job.recipes, shard)
    samples: list[Sample] = []
    rows: list[Mapping[str, Any]] = []
    failed: dict[int, str] = {}
    final = True
    for index in job.numbers(shard):
        split = job.plan.split(index)
        world = world_of(job, index // job.plan.asked.anatomy.samples)
        try:
            recipe = job.plan.recipe(index) if recipes is None else _taken(recipes[index], world)
            if job.plan.asked.storage.form == "recipe":
                rows.append({"index": index, "split": split, "failed": None, "recipe": recipe.as_json()})
                continue
            sample = world.sample(recipe, split)
            _check_arrays(sample, job.forms)
        except (OSError, MissingExtraError, MemoryError, WorkerError):
            raise
        except Exception as error:  # whatever is wrong with one sample must not end the others
            failed[index] = _without_names(_in_a_line(error), job, index)[:_LONGEST_REASON]
            final = final and isinstance(error, _KNOWN)
            rows.append({"index": index, "split": split, "failed": failed[index]})
            continue
        samples.append(sample)
        rows.append(sample.row)
    files = _files(job, shard, samples, rows)
    for name, content in files.items():
        job.place.write(name, content)
    hashes = {name: (hashlib.sha256(content).hexdigest(), len(content)) for name, content in files.items()}
    receipt = Receipt(
        shard=shard, first=job.numbers(shard)[0], samples=len(rows), files=hashes, failed=failed, final=final
    )
    job.place.write(receipt_name(shard), json.dumps(receipt.as_json(), indent=1).encode())
    return receipt


def world_of(job: Job, anatomy: int) -> World:
    """Return the world of an anatomy, whose source is as it was planned; each thread keeps its last one.

    Raises
    ------
    WorkerError
        The label map or scene is another here.
    ValueError
        It cannot be read.
    """
    drawn, planned = job.plan.anatomy(anatomy), job.sources[job.plan.origin(anatomy)]
    if drawn.source.hash != planned:
        raise WorkerError(
            f"a worker reads another label map or scene than was planned: {drawn.source.hash} instead of {planned}; "
            "give all workers the same, and do not change them meanwhile"
        )
    key = (job.plan.asked.digest, anatomy, planned, tuple(job.labels.items()))
    if getattr(_kept, "key", None) != key:
        _kept.key = None
        _kept.world = World(drawn, job.labels)
        _kept.key = key
    world: World = _kept.world
    return world


def check_worker(asked: Provenance, *, who: str = "a worker") -> None:
    """Raise WorkerError where this process would make other bits than those a plan says."""
    differs = difference(asked, provenance())
    if differs:
        raise WorkerError(f"{who} would make other bits: its {differs}; take the same as made the rest")


def _recipes(place: Store, shard: int) -> dict[int, Recipe | str]:
    """Those of a shard by their numbers; of a sample that failed, why."""
    rows = read_rows(place.read(table_name(shard)), ["index", "failed", "recipe"])
    return {row["index"]: Recipe.parse(row["recipe"]) if row["failed"] is None else row["failed"] for row in rows}


def _taken(recipe: Recipe | str, world: World) -> Recipe:
    """A recipe that was drawn from the same source; one that failed fails again."""
    if isinstance(recipe, str):
        raise RuntimeError(recipe)
    if recipe.scene != world.anatomy.source.hash:
        raise WorkerError(
            f"recipe {recipe.index} was drawn from another label map or scene, {recipe.scene}; bring that back"
        )
    return recipe


def _files(job: Job, shard: int, samples: list[Sample], rows: list[Mapping[str, Any]]) -> dict[str, bytes]:
    asked = job.plan.asked
    form = asked.storage.form
    table = {table_name(shard): parquet(rows, RECIPE_COLUMNS if form == "recipe" else COLUMNS)}
    if form == "recipe":
        return table
    if form == "webdataset":
        return {tar_name(shard): tar(samples, job.forms), **table}
    numbers = job.numbers(shard)
    arrays = {name: what.empty(len(numbers)) for name, what in job.forms.items()}
    for sample in samples:
        for name, array in sample.arrays.items():
            arrays[name][sample.recipe.index - numbers[0]] = array
    return {**shard_files(job.forms, arrays, asked.samples, asked.shard, shard), **table}


def _check_arrays(sample: Sample, forms: Mapping[str, ArrayForm]) -> None:
    for name, what in forms.items():
        if np.shape(sample.arrays[name]) != what.shape:
            held = np.shape(sample.arrays[name])
            raise ValueError(f"{name} has shape {held} where others have {what.shape}; give view ranges of one value")


def _in_a_line(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if isinstance(error, _KNOWN) else f"{type(error).__name__}: {text}"


def _without_names(text: str, job: Job, index: int) -> str:
    """A reason with hashes instead of the names of label maps and of what lies beside them."""
    asked = job.plan.asked
    origin = job.plan.origin(index // asked.anatomy.samples)
    if asked.storage.names_of_files or origin.file is None:
        return text
    files = [Path(origin.file), *(file for held in files_of(*scene_of(asked, origin)).values() for file in held)]
    for name in sorted({name for file in files for name in (str(file), file.name)}, key=len, reverse=True):
        text = text.replace(name, job.sources[origin])
    return text

"""Makes one shard: its samples, their files, and at the end the receipt that says it is whole."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._extras import MissingExtraError
from .layout import ArrayForm, array_forms, receipt_name, table_name, tar_name
from .plan import Plan
from .provenance import Provenance, difference, provenance
from .recipe import Recipe
from .sample import Sample, World
from .store import Store, StoreError
from .table_form import COLUMNS, RECIPE_COLUMNS, parquet, read_rows
from .tar_form import tar
from .zarr_form import shard_files

_LONGEST_REASON = 300
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

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        files = {name: {"sha256": hash_, "bytes": size} for name, (hash_, size) in sorted(self.files.items())}
        failed = {str(index): reason for index, reason in sorted(self.failed.items())}
        return {"shard": self.shard, "first": self.first, "samples": self.samples, "files": files, "failed": failed}

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
            )  # fmt: skip
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"receipt cannot be read ({error!r}); make the shard again") from None

    @property
    def bytes(self) -> int:
        """Length of its files together."""
        return sum(size for _, size in self.files.values())


def make_shard(job: Job, shard: int) -> Receipt:
    """Make a shard and store it.

    A sample that cannot be made is listed with its reason and does not stop the others.

    Raises
    ------
    WorkerError
        This process would make other bits than the plan says.
    StoreError
        The files cannot be written.
    """
    check_worker(job.made_by)
    recipes = None if job.recipes is None else _recipes(job.recipes, shard)
    samples: list[Sample] = []
    rows: list[Mapping[str, Any]] = []
    failed: dict[int, str] = {}
    for index in job.numbers(shard):
        split = job.plan.split(index)
        try:
            recipe = job.plan.recipe(index) if recipes is None else recipes[index]
            if job.plan.asked.storage.form == "recipe":
                rows.append({"index": index, "split": split, "failed": None, "recipe": recipe.as_json()})
                continue
            sample = world_of(job, recipe.anatomy).sample(recipe, split)
            _check_arrays(sample, job.forms)
        except (StoreError, MissingExtraError, MemoryError):
            raise
        except Exception as error:  # whatever is wrong with one sample must not end the others
            failed[index] = _in_a_line(error)
            rows.append({"index": index, "split": split, "failed": failed[index]})
            continue
        samples.append(sample)
        rows.append(sample.row)
    files = _files(job, shard, samples, rows)
    for name, content in files.items():
        job.place.write(name, content)
    hashes = {name: (hashlib.sha256(content).hexdigest(), len(content)) for name, content in files.items()}
    receipt = Receipt(shard=shard, first=job.numbers(shard)[0], samples=len(rows), files=hashes, failed=failed)
    job.place.write(receipt_name(shard), json.dumps(receipt.as_json(), indent=1).encode())
    return receipt


def world_of(job: Job, anatomy: int) -> World:
    """Return the world of an anatomy; each thread keeps its last one."""
    key = (job.plan.asked.digest, anatomy)
    if getattr(_kept, "key", None) != key:
        _kept.key = None
        _kept.world = World(job.plan.anatomy(anatomy), job.labels)
        _kept.key = key
    world: World = _kept.world
    return world


def check_worker(asked: Provenance, *, who: str = "a worker") -> None:
    """Raise WorkerError where this process would make other bits than those a plan says."""
    differs = difference(asked, provenance())
    if differs:
        raise WorkerError(f"{who} would make other bits: its {differs}; take the same as made the rest")


def _recipes(place: Store, shard: int) -> dict[int, Recipe]:
    """Those of a shard that did not fail when they were drawn."""
    rows = read_rows(place.read(table_name(shard)), ["index", "recipe"])
    return {row["index"]: Recipe.parse(row["recipe"]) for row in rows if row["recipe"] is not None}


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
    known = isinstance(error, (ValueError, RuntimeError))
    return (text if known else f"{type(error).__name__}: {text}")[:_LONGEST_REASON]
